#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# A long show: real server, synthetic agent, viewers that join, leave and stall; a table of memory, threads and drops.
#
#   tests/soak.sh [FRAMES] [SEED]     default 10,000 pictures, 6 minutes
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case ${1:-} in -h | --help) sed -n '3,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
deploy/build.sh
exec python3 tests/e2e/soak.py build "$@"
