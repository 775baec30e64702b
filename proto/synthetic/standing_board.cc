// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/standing_board.h"

#include <cmath>

namespace mixstage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr float kWhite = 0.82f, kBlack = 0.035f, kBack = 0.45f;  // printed paper on a grey plate

// Linear albedo of a board's front.
float FrontAlbedo(const Board& board, double x, double y) {
  const double i = std::floor(x / board.square_m) + 1;  // of the squares, 0 .. columns
  const double j = std::floor(y / board.square_m) + 1;
  if (i < 0 || j < 0 || i > board.columns || j > board.rows) return kWhite;
  return (static_cast<int>(i) + static_cast<int>(j)) % 2 == 0 ? kBlack : kWhite;
}

}  // namespace

std::optional<StandingBoard::Met> StandingBoard::Meet(const Ray& ray) const {
  const Vector3d z = T_world_board.linear().col(2);
  const double towards = z.dot(ray.direction);
  if (towards == 0) return std::nullopt;
  const double range_m = z.dot(T_world_board.translation() - ray.origin) / towards;
  if (!(range_m > 1e-6)) return std::nullopt;
  const Vector3d on = ray.origin + range_m * ray.direction - T_world_board.translation();
  const Vector2d at(T_world_board.linear().col(0).dot(on), T_world_board.linear().col(1).dot(on));
  if ((at.array() < board.Low().array()).any() || (at.array() > board.High().array()).any())
    return std::nullopt;
  return Met{range_m, at, towards > 0};
}

float StandingBoard::AlbedoAt(const Met& met) const {
  return met.front ? FrontAlbedo(board, met.at.x(), met.at.y()) : kBack;
}

Vector3d StandingBoard::Center() const {
  const Vector2d middle = 0.5 * (board.Low() + board.High());
  return T_world_board * Vector3d(middle.x(), middle.y(), 0);
}

std::optional<BoardHit> MeetBoards(const std::vector<StandingBoard>& boards, const Ray& ray, double limit_m) {
  std::optional<BoardHit> nearest;
  for (std::size_t i = 0; i < boards.size(); ++i) {
    const auto met = boards[i].Meet(ray);
    if (!met || met->range_m >= limit_m) continue;
    limit_m = met->range_m;
    nearest = BoardHit{i, *met};
  }
  return nearest;
}

}  // namespace mixstage
