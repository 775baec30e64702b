#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds targets of a sanitizer preset (asan or tsan, cmake/Sanitize.cmake) and shows the log only when that fails.
#
#   tests/sanitize/build.sh PRESET TARGET...
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
preset=$1
shift
log=$(mktemp)
trap 'rm -f "$log"' EXIT
echo "building $* into build-$preset"
if ! { cmake --preset "$preset" && cmake --build "build-$preset" --target "$@"; } >"$log" 2>&1; then
  tail -n 60 "$log"
  echo "FAIL build-$preset: see above"
  exit 1
fi
