#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The unit tests that start threads (gateway, queues, live show, viewer) under Clang's ThreadSanitizer.
#
#   tests/tsan.sh [GTEST_FILTER]
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case ${1:-} in -h | --help) sed -n '3,5s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
tests/sanitize/build.sh tsan mixstage_tests || exit 1
export TSAN_OPTIONS=suppressions=tests/sanitize/races.txt:print_suppressions=0:second_deadlock_stack=1
tests/support/run_gtest.py --prefix tsan. build-tsan/tests/mixstage_tests "${1:-*}"
