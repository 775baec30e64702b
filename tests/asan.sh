#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The unit tests under Clang's AddressSanitizer (leaks too) and UndefinedBehaviorSanitizer.
# Without a filter all but those that trace the synthetic set ray by ray or draw hundreds of samples to know a deviation:
# hours, and no byte of theirs is a stranger's.
#
#   tests/asan.sh [GTEST_FILTER]
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case ${1:-} in -h | --help) sed -n '3,7s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
tests/sanitize/build.sh asan mixstage_tests || exit 1
all='*-SyntheticScene.*:RoundCone.*:Figure*:TofView.*:UnprojectionTable.*'
all+=':RoomDepthProbe.ADropOverTheFloorRestsOnIt:PixelAdjustment.*:*.*DeviationsAreThose*'
export UBSAN_OPTIONS=print_stacktrace=1 LSAN_OPTIONS=suppressions=tests/sanitize/leaks.txt:print_suppressions=0
tests/support/run_gtest.py --shards 2 --prefix asan. build-asan/tests/mixstage_tests "${1:-$all}"
