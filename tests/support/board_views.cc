// SPDX-License-Identifier: Apache-2.0
#include "tests/support/board_views.h"

#include <numbers>
#include <numeric>
#include <random>

#include "tests/support/board_picture.h"

namespace mixstage {
namespace {

RigidTransform Aside(double x_m, double y_m, double z_m, double turn_x_deg, double turn_y_deg) {
  constexpr double kRad = std::numbers::pi / 180;
  RigidTransform T = RigidTransform::Identity();
  T.linear() = (Eigen::AngleAxisd(turn_y_deg * kRad, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(turn_x_deg * kRad, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  T.translation() = Eigen::Vector3d(x_m, y_m, z_m);
  return T;
}

// The whole board as a camera sees it; nothing where a corner is outside its picture.
std::optional<BoardSighting> Look(const BoardScene& scene, std::size_t camera, std::size_t placement) {
  const Placement& p = scene.placements[placement];
  const Board& board = scene.boards[p.board];
  BoardSighting s;
  s.board = p.board;
  s.corners.resize(static_cast<std::size_t>(board.corners()));
  std::iota(s.corners.begin(), s.corners.end(), 0);
  const RigidTransform T = scene.TCameraBoard(camera, placement);
  for (int i : s.corners) {
    const auto pixel = scene.cameras[camera].lens.Project(T * board.Corner(i));
    if (!pixel || !scene.cameras[camera].lens.Sees(*pixel, 3)) return std::nullopt;
    s.pixels.push_back(*pixel);
  }
  s.square_px = (s.pixels[1] - s.pixels[0]).norm();
  return s;
}

}  // namespace

BoardScene TrueRigWithoutViews() {
  BoardScene scene;
  scene.boards = {{"a", 9, 6, 0.07, 0.07}, {"b", 7, 5, 0.07, 0.07}};
  PinholeCamera color{640, 480, 683.5, 684.2, 325.9, 234.7, -0.12, 0.06};
  PinholeCamera tof{176, 144, 220.6, 220.4, 90.5, 69.0, -0.25, 0.1};
  FisheyeCamera fisheye{480, 480, 139.5, 139.7, 242.0, 237.8, 0.012, -0.006, 0.0012, -0.0002};
  scene.cameras.push_back({"color", LensOf(color), RigidTransform::Identity(), 0.1});
  scene.cameras.push_back({"depth", LensOf(tof), Aside(0.07, -0.02, 0.006, 0.9, -1.3), 0.1});
  scene.cameras.push_back({"fisheye", LensOf(fisheye), Aside(-0.06, -0.04, -0.01, -1.1, 1.6), 0.1});
  return scene;
}

void AddTrueViews(BoardScene& scene, std::size_t board, int count, int wide, double noise_px,
                  std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> noise(0, 1);
  auto uniform = [&](double a, double b) { return std::uniform_real_distribution<double>(a, b)(random); };
  auto add = [&](const RigidTransform& T_first_board, std::size_t first_camera) {
    const std::size_t index = scene.placements.size();
    scene.placements.push_back({"view/" + std::to_string(index), index, board, T_first_board, false});
    for (std::size_t c = first_camera; c < scene.cameras.size(); ++c) {
      auto s = Look(scene, c, index);
      if (!s) continue;
      for (Eigen::Vector2d& p : s->pixels) p += noise_px * Eigen::Vector2d(noise(random), noise(random));
      scene.sightings.push_back({c, index, *s, "picture " + std::to_string(c), "", 0});
    }
  };
  const Board& b = scene.boards[board];
  for (int i = 0; i < count; ++i) {
    const double z = uniform(1.1, 3.5);
    add(BoardAt(b, z, uniform(-40, 40), uniform(-40, 40), uniform(-30, 30), z * uniform(-0.2, 0.2),
                z * uniform(-0.15, 0.15)),
        0);
  }
  for (int i = 0; i < wide; ++i) {
    constexpr double kRad = std::numbers::pi / 180;
    const RigidTransform near =
        BoardAt(b, uniform(0.9, 1.4), uniform(-25, 25), uniform(-25, 25), uniform(-180, 180));
    RigidTransform turn = RigidTransform::Identity();
    turn.linear() = (Eigen::AngleAxisd(uniform(-180, 180) * kRad, Eigen::Vector3d::UnitZ()) *
                     Eigen::AngleAxisd(uniform(25, 75) * kRad, Eigen::Vector3d::UnitY()))
                        .toRotationMatrix();
    add(*scene.cameras.back().T_first_camera * turn * near, scene.cameras.size() - 1);
  }
}

}  // namespace mixstage
