// SPDX-License-Identifier: Apache-2.0
//
// Checkerboards that stand in the synthetic room, for calibration views. A board hides what is behind it; it
// throws no shadow and no light back.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "proto/geometry/board.h"
#include "proto/geometry/frames.h"
#include "proto/synthetic/room.h"

namespace mixstage {

struct StandingBoard {
  Board board;
  RigidTransform T_world_board = RigidTransform::Identity();

  struct Met {
    double range_m = 0;
    Eigen::Vector2d at = Eigen::Vector2d::Zero();  // in the board's frame
    bool front = true;                             // else its grey back
  };
  // Where a ray (world, any direction's length: range is in units of it) goes through the paper.
  [[nodiscard]] std::optional<Met> Meet(const Ray& ray) const;
  [[nodiscard]] float AlbedoAt(const Met& met) const;
  // Towards whom it looks, world.
  [[nodiscard]] Eigen::Vector3d FrontNormal() const { return -T_world_board.linear().col(2); }
  [[nodiscard]] Eigen::Vector3d Center() const;
};

// The nearest board that a ray meets, by index; nothing where it meets none before `limit_m`.
struct BoardHit {
  std::size_t board = 0;
  StandingBoard::Met met;
};
std::optional<BoardHit> MeetBoards(const std::vector<StandingBoard>& boards, const Ray& ray, double limit_m);

}  // namespace mixstage
