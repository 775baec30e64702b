// SPDX-License-Identifier: Apache-2.0
//
// Poses that came a view late or early: a robot's stream and the camera's, out of step. Every pose is good,
// of another picture; no refinement finds home from there.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "proto/geometry/rig.h"
#include "server/environment/range_view.h"

namespace mixstage {

struct OrderedView {
  cv::Mat3b bgr;           // shares its pixels
  const RangeView* range;  // not null
  RigidTransform T_world_color;
};

// In the order they were taken. How many views too late the poses come (below 0: too early), at most two:
// view i + k has the pose of view i. 0 unless the pictures agree far better that way: where points that one
// view measured fall into another, both show the same brightness.
int PosesLate(const std::vector<OrderedView>& views, const RangeCamera& depth, const PinholeCamera& color);

}  // namespace mixstage
