// SPDX-License-Identifier: Apache-2.0
//
// Pictures of boards with known truth: every pixel is the mean of 49 rays through a Gaussian spot, traced to
// the board's plane.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/geometry/board.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"

namespace mixstage {

struct BoardPictureLook {
  double spot_px = 0.6;                             // sigma of the Gaussian spot
  double white = 0.7, black = 0.06, behind = 0.25;  // of the brightest value
  double slope = 0;                                 // white falls by this share over the picture's width
  double noise = 0.01;                              // sigma, of the brightest value
  std::uint64_t seed = 1;
};

struct PlacedBoard {
  Board board;
  RigidTransform T_camera_board = RigidTransform::Identity();
};

// [h x w] linear brightness 0..1.
cv::Mat1f DrawBoards(const PinholeCamera& camera, const std::vector<PlacedBoard>& boards,
                     const BoardPictureLook& look);
cv::Mat1f DrawBoards(const FisheyeCamera& camera, const std::vector<PlacedBoard>& boards,
                     const BoardPictureLook& look);

// sRGB, 8 bit.
cv::Mat1b ToSrgb8(const cv::Mat1f& linear);

// A pose that looks at the board's middle from `distance_m`, turned by the three angles (degrees).
RigidTransform BoardAt(const Board& board, double distance_m, double turn_x_deg, double turn_y_deg,
                       double turn_z_deg, double shift_x_m = 0, double shift_y_m = 0);

}  // namespace mixstage
