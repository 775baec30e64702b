// SPDX-License-Identifier: Apache-2.0
//
// Where a head has to stop so that its pictures cover a part of the room (MixIn3D 2.3: a sweep whose
// neighbouring pictures overlap by half).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"

namespace mixstage {

struct HeadPosition {
  double pan_deg = 0, tilt_deg = 0;  // encoder readings
};

// What the pictures shall cover, in encoder angles of the camera's axis: a span of pan and one of tilt.
struct SweepArea {
  double pan_from_deg = -60, pan_to_deg = 60;    // from <= to, at most 360 apart
  double tilt_from_deg = -50, tilt_to_deg = 50;  // from <= to, within +-90
};

// Angle in degrees that colour and depth camera both see, across and up (through the picture's middle).
Eigen::Vector2d SharedFieldOfView_deg(const Rig& rig);

// Positions row by row, from the top, each row in the direction against the one before. Neighbours overlap by
// at least half a field of view, the outermost pictures reach the area's edges; a whole turn closes. Fails
// (kInvalidConfig) for an area that is none.
Result<std::vector<HeadPosition>> SweepGrid(const Rig& rig, const SweepArea& area);

}  // namespace mixstage
