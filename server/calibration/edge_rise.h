// SPDX-License-Identifier: Apache-2.0
//
// How sharp a picture of a board is.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/geometry/board.h"

namespace mixstage {

// Width (px, 10 to 90 % of a Gaussian step) of the edges between a whole board's inner corners: from the
// spread of the brightness gradient across them, the pixel's own size included. 0 where no edge can be
// measured.
[[nodiscard]] double EdgeRise(const cv::Mat1b& picture, const Board& board,
                              const std::vector<Eigen::Vector2d>& pixels);

}  // namespace mixstage
