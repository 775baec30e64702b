#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs, builds and runs every test. The last line is "N passed, M failed, K skipped".
#
#   tests/run.sh             all
#   tests/run.sh FILTER      parts whose name contains FILTER; anything else is a gtest filter: tests/run.sh 'DepthCodec*'
#
#   repo     the repository itself           data     recordings, where there are any
#   unit     C++, release build by GCC       browser  the page in Chromium
#   page     TypeScript                      soak     1,000 pictures with a restless crowd of viewers
#   e2e      real programs, real sockets     asan     the unit tests under ASan and UBSan, a second build by Clang
#   chain    the synthetic rig calibrated,   fuzz     every fuzzer for 10 s, from that build
#            its room scanned, keyed against
#   loss     e2e over a bad network
#
# Longer, by hand: tests/fuzz.sh SECONDS, tests/soak.sh, tests/tsan.sh.
set -uo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
filter=${1:-}
case $filter in -h | --help) sed -n '3,17s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac

parts=(repo unit page e2e chain loss data browser soak asan fuzz)
chosen=() gtest_filter='*'
for part in "${parts[@]}"; do [[ $part == *"$filter"* ]] && chosen+=("$part"); done
if [ ${#chosen[@]} = 0 ]; then chosen=(unit) gtest_filter=$filter; fi

passed=0 failed=0 skipped=0
finish() { echo "$passed passed, $failed failed, $skipped skipped"; [ "$failed" = 0 ] && exit 0; exit 1; }

if ! deploy/install.sh || ! deploy/build.sh; then
  echo "FAIL build"
  failed=1
  finish
fi

# Runs a command that prints "ok NAME", "FAIL NAME: why" and "SKIP NAME: why" lines, and adds them up. A command that
# fails without saying what counts as one failure.
tally() {
  local name=$1 log code before=$failed
  shift
  log=$(mktemp)
  echo "== $name"
  "$@" 2>&1 | tee "$log"
  code=${PIPESTATUS[0]}
  passed=$((passed + $(grep -c '^ok ' "$log")))
  failed=$((failed + $(grep -c '^FAIL ' "$log")))
  skipped=$((skipped + $(grep -c '^SKIP ' "$log")))
  if [ "$code" != 0 ] && [ "$failed" = "$before" ]; then
    echo "FAIL $name: exit code $code"
    failed=$((failed + 1))
  fi
  rm -f "$log"
}

for part in "${chosen[@]}"; do
  case $part in
    repo) tally repo tests/repo/run.sh ;;
    unit) tally unit tests/support/run_gtest.py build/tests/mixstage_tests "$gtest_filter" ;;
    page) tally page tests/support/run_page_tests.sh ;;
    e2e) tally e2e python3 tests/e2e/run.py build; tally meshes /usr/bin/python3 tests/e2e/meshes.py build
      tally avatar /usr/bin/python3 tests/e2e/avatar.py build; tally regions /usr/bin/python3 tests/e2e/regions.py build
      tally left_behind /usr/bin/python3 tests/e2e/left_behind.py build ;;
    chain) tally chain python3 tests/e2e/studio_chain.py build ;;
    loss) tally loss python3 tests/e2e/loss.py build ;;
    data) tally data python3 tests/e2e/recordings.py build; tally calibration python3 tests/e2e/calibration.py build
      tally scan python3 tests/e2e/scan.py build
      tally boards tests/support/run_gtest.py build/tests/real_boards ;;
    browser) tally browser tests/browser/run.sh build ;;
    asan) tally asan tests/asan.sh ;;
    fuzz) FUZZ_SEED=1 tally fuzz tests/fuzz.sh 10 ;;
    soak) tally soak python3 tests/e2e/soak.py build 1000 ;;
  esac
done
finish
