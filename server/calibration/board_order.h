// SPDX-License-Identifier: Apache-2.0
//
// Which corner is the first: a detector's grid of corners is checked against the picture and counted in the
// board's own order (board.h).
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/geometry/board.h"

namespace mixstage {

// Counts `pixels` ([columns x rows], row by row, any of its four ends first, possibly mirrored) in the
// board's order. False when they are no such board: squares whose colours do not alternate, lines that fold,
// or a larger board's part (the pattern goes on beyond the outer squares).
bool PutInBoardOrder(const cv::Mat1b& picture, const Board& board, std::vector<Eigen::Vector2d>& pixels);

// The same grid turned by half a turn.
void TurnUpsideDown(std::vector<Eigen::Vector2d>& pixels);

}  // namespace mixstage
