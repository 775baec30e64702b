// SPDX-License-Identifier: Apache-2.0
//
// A rig of three cameras before boards, its corners by projection with Gaussian noise: known truth for
// adjustments.
#pragma once

#include <cstdint>

#include "server/calibration/board_scene.h"

namespace mixstage {

// Colour, ToF and fisheye (some 190 degrees) with distortion, the latter two centimetres aside.
BoardScene TrueRigWithoutViews();

// Adds `count` views of board `board` at varied distances and tilts, seen by all cameras whose picture holds
// the whole board, and `wide` more that only the last camera sees, far off its axis. Placements have their
// true poses.
void AddTrueViews(BoardScene& scene, std::size_t board, int count, int wide, double noise_px,
                  std::uint64_t seed);

}  // namespace mixstage
