// SPDX-License-Identifier: Apache-2.0
//
// Pose of a board from its corners through any lens, also beyond 90 degrees from its axis.
#pragma once

#include <optional>

#include "proto/geometry/frames.h"
#include "server/calibration/board_detection.h"
#include "server/calibration/lens.h"

namespace mixstage {

// T_camera_board: cv::solvePnP on the corners' rays, turned so that their mean is the axis. Nothing with
// fewer than 6 corners, a corner without a ray, or rays that lie in one plane or span more than 75 degrees
// about their mean.
[[nodiscard]] std::optional<RigidTransform> PoseOfBoard(const Lens& lens, const Board& board,
                                                        const BoardSighting& sighting);

}  // namespace mixstage
