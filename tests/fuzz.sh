#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Fuzzes every parser of bytes that are not ours (tests/fuzz/*.cc) under ASan and UBSan, two at a time, from the seeds in
# tests/fuzz/corpus. What it learns stays in build-asan/fuzz/TARGET, what breaks in build-asan/fuzz/broken.
#
#   tests/fuzz.sh [SECONDS] [TARGET]      each for SECONDS (default 60); TARGET: a name, e.g. jpeg
#   FUZZ_SEED=1 tests/fuzz.sh             from the same random numbers each time; without it from others
#   build-asan/tests/fuzz/fuzz_TARGET build-asan/fuzz/broken/FILE       shows one again
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case ${1:-} in -h | --help) sed -n '3,8s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
seconds=${1:-60} target=${2:-}

tests/sanitize/build.sh asan fuzzers || exit 1
mkdir -p build-asan/fuzz/broken
export UBSAN_OPTIONS=print_stacktrace=1 LSAN_OPTIONS=suppressions=tests/sanitize/leaks.txt:print_suppressions=0
fuzz() {
  local seconds=$1 name=$2 log
  mkdir -p "build-asan/fuzz/$name"
  log=build-asan/fuzz/$name.log
  if "build-asan/tests/fuzz/fuzz_$name" -seed="${FUZZ_SEED:-0}" -max_total_time="$seconds" -timeout=20 -rss_limit_mb=2048 -malloc_limit_mb=1024 \
    -artifact_prefix="build-asan/fuzz/broken/$name-" "build-asan/fuzz/$name" "tests/fuzz/corpus/$name" >"$log" 2>&1; then
    echo "ok fuzz.$name ($(grep -oP '^Done \K\d+' "$log") runs)"
  else
    tail -n 40 "$log"
    echo "FAIL fuzz.$name: $(grep -oP 'Test unit written to \K.*' "$log" || echo "see $log")"
    return 1
  fi
}
export -f fuzz
names=$(cd tests/fuzz && ls -- *.cc | sed 's/\.cc$//' | grep -x -- "${target:-.*}") ||
  { echo "FAIL fuzz: there is no target $target"; exit 1; }
xargs -P 2 -I{} bash -c 'fuzz "$@"' fuzz "$seconds" {} <<<"$names"
