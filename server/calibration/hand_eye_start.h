// SPDX-License-Identifier: Apache-2.0
//
// Start of the hand-eye adjustment: AX = XB over pairs of views that see the same board (Park and Martin
// 1994), the views chosen by consensus. cv::calibrateHandEye solves the same, but for one board in every view
// and with no outlier.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "proto/geometry/board.h"
#include "proto/geometry/frames.h"

namespace mixstage {

struct BoardInView {
  std::size_t view = 0, board = 0;
  RigidTransform T_color_board = RigidTransform::Identity();
};

struct HandEyeStart {
  RigidTransform T_hand_color = RigidTransform::Identity();
  std::vector<std::optional<RigidTransform>> T_base_board;  // nothing: no good view has it
  std::vector<bool> good;                                   // per view: agrees with most others
  double agreement = 0;  // share of pairs of views (same board) whose rotations fit
};

// Turns T_color_board of boards that look the same upside down so that all views agree on their first corner:
// the angle between two views is the hand's. True for those turned.
std::vector<bool> AgreeOnFirstCorner(const std::vector<RigidTransform>& T_base_hand,
                                     const std::vector<Board>& boards, std::vector<BoardInView>& seen);

// R_hand_color_guess steps in where the hand never turns about a second axis. Nothing when no three views
// agree.
std::optional<HandEyeStart> StartHandEye(const std::vector<RigidTransform>& T_base_hand,
                                         const std::vector<BoardInView>& seen, std::size_t board_count,
                                         const Eigen::Matrix3d& R_hand_color_guess);

}  // namespace mixstage
