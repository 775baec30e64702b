#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds MixStage (programs, page, tests) into build/. What demo.sh and tests/run.sh call.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
echo "building into $root/build (the first time takes some minutes)"
if ! { cmake --preset release && cmake --build --preset release; } >"$log" 2>&1; then
  tail -n 60 "$log" >&2
  exit 1
fi
