// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/views.h"

#include <cmath>
#include <numbers>

#include "proto/base/check.h"
#include "proto/geometry/sweep_grid.h"
#include "proto/synthetic/rig.h"

namespace mixstage {
namespace {

using Eigen::AngleAxisd;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kRadPerDeg = std::numbers::pi / 180;

// Prints of size A1.
const Board kBoardA{"board_a", 8, 5, 0.08, 0.055};
const Board kBoardB{"board_b", 7, 6, 0.08, 0.055};

struct Turn {
  double pitch_deg, yaw_deg, roll_deg;  // about the board's own x, y, z: 0 = it faces who looks at it
};

// A board whose middle lies at `center`, turned against one that faces `viewer` upright.
RigidTransform Facing(const Board& board, const Vector3d& center, const Vector3d& viewer, const Turn& turn) {
  const Vector3d z = (center - viewer).normalized();
  const Vector3d up = std::abs(z.z()) < 0.95 ? Vector3d::UnitZ() : Vector3d::UnitX();
  const Vector3d x = z.cross(up).normalized();
  RigidTransform T = RigidTransform::Identity();
  T.linear().col(0) = x;
  T.linear().col(1) = z.cross(x);
  T.linear().col(2) = z;
  T.linear() = T.linear() * (AngleAxisd(turn.roll_deg * kRadPerDeg, Vector3d::UnitZ()) *
                             AngleAxisd(turn.yaw_deg * kRadPerDeg, Vector3d::UnitY()) *
                             AngleAxisd(turn.pitch_deg * kRadPerDeg, Vector3d::UnitX()))
                                .toRotationMatrix();
  const Vector2d middle = 0.5 * (board.Low() + board.High());
  T.translation() = center - T.linear() * Vector3d(middle.x(), middle.y(), 0);
  return T;
}

// In the colour picture: u and v of the board's middle as shares of half its width and height.
struct ColorPlace {
  double u, v, distance_m;
  Turn turn;
};
constexpr ColorPlace kColorPlaces[] = {
    {0, 0, 1.15, {8, -6, 0}},        {0.1, 0.05, 1.35, {-30, 12, 4}}, {-0.12, 0, 1.4, {6, 38, -5}},
    {-0.5, -0.45, 1.9, {18, 22, 0}}, {0, -0.5, 1.9, {32, -4, 3}},     {0.5, -0.45, 1.9, {14, -26, -4}},
    {-0.52, 0, 1.8, {-6, 34, 2}},    {0, 0, 2.0, {24, 24, 45}},       {0.52, 0, 1.8, {8, -34, 0}},
    {-0.5, 0.48, 1.8, {-20, 20, 5}}, {0, 0.5, 1.8, {-32, 5, 0}},      {0.5, 0.48, 1.8, {-18, -22, 90}},
    {-0.68, -0.6, 2.6, {20, 20, 0}}, {0.68, -0.6, 2.6, {20, -24, 0}}, {-0.66, 0.6, 2.1, {-16, 26, 0}},
    {0.66, 0.6, 2.1, {-22, -20, 0}}, {0.25, -0.2, 3.2, {-10, 32, 0}}, {-0.3, -0.25, 3.7, {12, -34, 8}},
    {0.3, -0.35, 4.3, {0, 24, 0}},   {0.05, -0.4, 4.8, {6, -18, 0}},
};

// Beside the colour picture: degrees from the fisheye's axis, and around it from its right clockwise.
struct WidePlace {
  double from_axis_deg, around_deg, distance_m;
  Turn turn;
};
constexpr WidePlace kWidePlaces[] = {
    {36, 10, 1.3, {10, 18, 0}},   {38, 165, 1.3, {-8, -16, 0}}, {40, 285, 1.2, {16, 6, 0}},
    {38, 70, 1.1, {-12, 8, 5}},   {52, 40, 1.1, {6, -14, 0}},   {54, 140, 1.1, {-6, 14, -4}},
    {56, 200, 1.2, {14, 10, 0}},  {56, 335, 1.2, {-14, -8, 0}}, {68, 355, 1.2, {8, 16, 90}},
    {70, 185, 1.2, {-8, -18, 0}}, {68, 265, 0.9, {10, 8, 0}},   {80, 175, 1.7, {4, 12, 0}},
    {80, 5, 1.7, {-6, -12, 0}},   {80, 215, 1.5, {10, -8, 0}},  {80, 325, 1.5, {-10, 8, 0}},
};

std::vector<SyntheticView> CalibrationViews(const Rig& rig) {
  std::vector<SyntheticView> views;
  const RigidTransform T_world_color = SyntheticTWorldColor(rig);
  const PinholeCamera& c = rig.color;
  auto add = [&](const Vector3d& center, const Vector3d& viewer, const Turn& turn, RecordedBy by) {
    SyntheticView view;
    view.boards.push_back({kBoardA, Facing(kBoardA, center, viewer, turn)});
    view.recorded_by = by;
    views.push_back(std::move(view));
  };
  for (const ColorPlace& place : kColorPlaces) {
    const Vector3d ray(place.u * 0.5 * c.width / c.fx, place.v * 0.5 * c.height / c.fy, 1);
    add(T_world_color * (place.distance_m * ray.normalized()), T_world_color.translation(), place.turn,
        RecordedBy::kAll);
  }
  if (!rig.fisheye) return views;
  const RigidTransform T_world_fisheye = T_world_color * rig.T_color_fisheye;
  for (const WidePlace& place : kWidePlaces) {
    const double theta = place.from_axis_deg * kRadPerDeg;
    const double phi = place.around_deg * kRadPerDeg;
    const Vector3d ray(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
    add(T_world_fisheye * (place.distance_m * ray), T_world_fisheye.translation(), place.turn,
        RecordedBy::kFisheye);
  }
  return views;
}

std::vector<SyntheticView> HandEyeViews(const Rig& rig) {
  // On tripods left and right before the head: one of them is seen over most of its way.
  const Vector3d viewer = SyntheticTWorldColor(rig).translation();
  auto standing = [&](const Board& board, double azimuth_deg, double distance_m, double height_m,
                      const Turn& turn) {
    const double a = azimuth_deg * kRadPerDeg;
    const Vector3d center(viewer.x() + distance_m * std::cos(a), viewer.y() + distance_m * std::sin(a),
                          height_m);
    return StandingBoard{board, Facing(board, center, viewer, turn)};
  };
  const std::vector<StandingBoard> boards = {standing(kBoardA, 27, 2.5, 1.25, {8, -14, 0}),
                                             standing(kBoardB, -7, 2.5, 1.25, {-10, 18, 0})};
  constexpr double kPositions[][2] = {{0, 0},    {0, 15},    {-1, -10}, {-16, 8}, {-30, 15},
                                      {-34, -3}, {-22, -10}, {-12, 18}, {15, -9}, {30, -10},
                                      {34, 4},   {23, 16},   {10, 5},   {-26, 3}};
  std::vector<SyntheticView> views;
  for (const auto& [pan_deg, tilt_deg] : kPositions)
    views.push_back({pan_deg, tilt_deg, boards, RecordedBy::kColorAndDepth});
  return views;
}

}  // namespace

std::vector<Board> BoardsOf(SyntheticViews views) {
  switch (views) {
    case SyntheticViews::kCalibration:
      return {kBoardA};
    case SyntheticViews::kHandEye:
      return {kBoardA, kBoardB};
    case SyntheticViews::kScan:
      break;
  }
  return {};
}

std::vector<SyntheticView> ViewsOf(SyntheticViews views, const Rig& rig) {
  if (views == SyntheticViews::kCalibration) return CalibrationViews(rig);
  if (views == SyntheticViews::kHandEye) return HandEyeViews(rig);
  const auto grid = SweepGrid(rig, {});
  MIX_CHECK(grid.has_value());
  std::vector<SyntheticView> scan;
  for (const HeadPosition& at : *grid) scan.push_back({at.pan_deg, at.tilt_deg, {}, RecordedBy::kAll});
  return scan;
}

}  // namespace mixstage
