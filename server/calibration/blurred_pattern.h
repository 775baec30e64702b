// SPDX-License-Identifier: Apache-2.0
//
// A checkerboard through a Gaussian spot, in closed form: near a corner the product of two sign functions,
// averaged over a two-dimensional Gaussian, is a bivariate normal orthant probability (tetrachoric series:
// Kendall 1941); along an edge it becomes the error function.
#pragma once

#include <Eigen/Core>

#include "proto/geometry/board.h"

namespace mixstage {

struct PatternValue {
  double white = 0;                                    // share of white in the spot, 0..1
  Eigen::Vector2d by_place = Eigen::Vector2d::Zero();  // of the spot's centre on the board, per square
  double by_spot = 0;                                  // by the spot's sigma, per px
  bool known = false;  // false where the series does not converge: very slanting views, next to a corner
};

// place: centre of the spot on the board, squares (corner (0, 0) at the origin), nearest inner lines only.
// squares_by_pixel: how the place moves with the picture, squares per px. spot_px: sigma in the picture.
PatternValue BlurredPattern(const Board& board, const Eigen::Vector2d& place,
                            const Eigen::Matrix2d& squares_by_pixel, double spot_px);

}  // namespace mixstage
