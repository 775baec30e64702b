// SPDX-License-Identifier: Apache-2.0
//
// What an engineer would record of the synthetic set to calibrate its rig and to scan the room.
#pragma once

#include <vector>

#include "proto/geometry/rig.h"
#include "proto/synthetic/standing_board.h"

namespace mixstage {

enum class SyntheticViews {
  kCalibration = 1,  // one board held before the head at rest: over the pictures, near and far, tilted
  kHandEye,          // boards fixed in the room, the head turns
  kScan,             // the empty room, 120 x 100 degrees
};

enum class RecordedBy {
  kAll = 1,
  kColorAndDepth,
  kFisheye,  // the board is beside the other cameras' pictures
};

struct SyntheticView {
  double pan_deg = 0, tilt_deg = 0;  // encoder angles, without their noise
  std::vector<StandingBoard> boards;
  RecordedBy recorded_by = RecordedBy::kAll;
};

// Kinds of boards in these views: what board.json lists. Empty for a scan.
std::vector<Board> BoardsOf(SyntheticViews views);

// Boards are placed before the rig's cameras; the room's furniture is the demonstration's.
std::vector<SyntheticView> ViewsOf(SyntheticViews views, const Rig& rig);

}  // namespace mixstage
