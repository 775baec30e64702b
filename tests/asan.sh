#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The unit tests under Clang's AddressSanitizer (leaks too) and UndefinedBehaviorSanitizer.
# Without a filter all but those that trace the synthetic set ray by ray, look at hundreds of drawn boards or measure how
# exact a result is: minutes each, and what they call is called by others too.
# (A limit of memory is not to be tested under ASan, which reserves terabytes.)
#
#   tests/asan.sh [GTEST_FILTER]
set -uo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case ${1:-} in -h | --help) sed -n '3,8s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit 0 ;; esac
tests/sanitize/build.sh asan mixstage_tests || exit 1
all='*-SyntheticScene.*:RoundCone.*:Figure*:TofView.*:UnprojectionTable.*:PixelAdjustment.*:*.*DeviationsAreThose*'
all+=':BoardPictureFit.*:*.NoBoardNoSighting:*.APartOfALargerBoard*:DenseSurface.*:RoomPlanes.AreExact*'
all+=':BoardDetection.FindsTwoBoards*:BoardDetection.ABoardUpsideDown*:MeetRooms.*:CalibrationGates.VariedViewsPass:HandEye.FindsASkewed*'
all+=':HandEye.ALensThatIsNotKnown*:BlurredPattern.IsTheMean*:JointAdjustment.CamerasAgree*:EdgePlacement.Brings*:FindLamps.Place*:SurfaceMesh.IsCut*'
all+=':MovingLimb.*:StudioTest.AScannedRoomNeeds*:StudioTest.WithoutDepth*'
all+=':AvatarTest.*:ModelProcess.AModelBeyondItsMemory*:RoomDepthProbe.ADropOverTheFloorRestsOnIt:StudioTest.AReflectorMay*:StudioTest.TheFigureHides*:StudioTest.LearnsTheEmptySet*:StudioTest.DepthsWrongClock*:*.TheViewersActorAndRoom*'
export UBSAN_OPTIONS=print_stacktrace=1 LSAN_OPTIONS=suppressions=tests/sanitize/leaks.txt:print_suppressions=0
tests/support/run_gtest.py --shards 2 --prefix asan. build-asan/tests/mixstage_tests "${1:-$all}"
