// SPDX-License-Identifier: Apache-2.0
#include "server/render/room_view.h"

#include <gtest/gtest.h>

#include <cmath>

#include "proto/base/srgb.h"

namespace mixstage {
namespace {

constexpr double kWall_m = 3;

// A wall across the world's x axis at 3 m, 6 x 4 m, as 2 triangles; red falls across, green down, blue is
// even.
RoomModel Wall() {
  RoomModel room;
  room.positions = {{kWall_m, 3, 2}, {kWall_m, -3, 2}, {kWall_m, -3, -2}, {kWall_m, 3, -2}};
  room.uvs = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  room.indices = {0, 2, 1, 0, 3, 2};
  room.texture_bgr.create(512, 768);
  for (int y = 0; y < 512; ++y) {
    for (int x = 0; x < 768; ++x)
      room.texture_bgr(y, x) = {90, static_cast<std::uint8_t>(40 + y / 4),
                                static_cast<std::uint8_t>(230 - x / 4)};
  }
  return room;
}

Rig SomeRig() {
  Rig rig = AssumedRig(321, 240, 0.001);  // odd: the last column of half pixels covers one
  rig.color.fx = rig.color.fy = 300;
  rig.color.cx = 165;
  rig.color.cy = 116;
  rig.color.k1 = -0.12;
  rig.color.k2 = 0.06;
  rig.vignetting_a = -0.2;
  return rig;
}

// Looks along +x from a little off the origin, turned about the vertical.
RigidTransform LookAhead(double turned_deg) {
  RigidTransform T = RigidTransform::Identity();
  T.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  T.linear() =
      Eigen::AngleAxisd(turned_deg * M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix() * T.linear();
  T.translation() << 0.1, -0.2, 0.05;
  return T;
}

// Where the ray of a pixel meets the wall.
Eigen::Vector3d OnWall(const Rig& rig, const RigidTransform& T_world_color, double u, double v) {
  const Eigen::Vector2d ray = *rig.color.Unproject({u, v});
  const Eigen::Vector3d direction = T_world_color.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1);
  const Eigen::Vector3d from = T_world_color.translation();
  return from + (kWall_m - from.x()) / direction.x() * direction;
}

double LinearAt(double code) {
  const double v = code / 255;
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

// What the camera shows of the wall at (u, v): B G R.
std::array<double, 3> TrueColor(const Rig& rig, const RigidTransform& T, double u, double v) {
  const Eigen::Vector3d p = OnWall(rig, T, u, v);
  const double x = (3 - p.y()) / 6 * 768 - 0.5;
  const double y = (2 - p.z()) / 4 * 512 - 0.5;
  const double r2 = (std::pow(u - rig.color.cx, 2) + std::pow(v - rig.color.cy, 2)) /
                    (0.25 * (std::pow(rig.color.width, 2) + std::pow(rig.color.height, 2)));
  std::array<double, 3> out{};
  const std::array<double, 3> code = {90, 40 + (y - 1.5) / 4, 230 - (x - 1.5) / 4};
  for (std::size_t c = 0; c < 3; ++c)
    out[c] = SrgbTables::Get().ToSrgb(static_cast<float>(LinearAt(code[c]) * (1 + rig.vignetting_a * r2)));
  return out;
}

TEST(RoomView, DepthAndColorAreTheLensesOwn) {
  const Rig rig = SomeRig();
  auto view = RoomView::Create(rig, Wall());
  ASSERT_TRUE(view) << view.error().message;
  const RigidTransform T = LookAhead(12);
  const RoomPrediction& room = view->Look(T);
  const cv::Mat3b picture = view->Picture();
  ASSERT_EQ(room.depth_m.size(), cv::Size(321, 240));
  ASSERT_EQ(room.r.size(), cv::Size(161, 120));
  for (int v = 0; v < 240; v += 3) {
    for (int u = 0; u < 321; u += 3) {
      const double z = (T.inverse() * OnWall(rig, T, u, v)).z();
      ASSERT_NEAR(room.depth_m(v, u), z, 0.001) << u << " " << v;
      const auto color = TrueColor(rig, T, u, v);
      for (int c = 0; c < 3; ++c)
        ASSERT_NEAR(picture(v, u)[c], color[static_cast<std::size_t>(c)], 1.5) << u << " " << v;
    }
  }
  for (int v = 0; v < 120; v += 2) {
    for (int u = 0; u < 160; u += 2) {
      const auto color = TrueColor(rig, T, 2 * u + 0.5, 2 * v + 0.5);
      ASSERT_EQ(room.seen(v, u), RoomPrediction::kSeen);
      ASSERT_NEAR(room.b(v, u), color[0], 1.5);
      ASSERT_NEAR(room.g(v, u), color[1], 1.5);
      ASSERT_NEAR(room.r(v, u), color[2], 1.5);
    }
  }
}

TEST(RoomView, DrawsAnewOnlyWhereThePoseMoves) {
  auto view = RoomView::Create(SomeRig(), Wall());
  ASSERT_TRUE(view);
  const auto first = view->Look(LookAhead(0)).drawing;
  EXPECT_EQ(view->Look(LookAhead(0.001)).drawing, first);  // 0.005 px
  EXPECT_EQ(view->Look(LookAhead(0.003)).drawing, first);
  EXPECT_NE(view->Look(LookAhead(0.01)).drawing, first);  // small steps add up to 0.05 px
  RigidTransform T = LookAhead(0.01);
  T.translation().y() += 0.001;
  const auto before = view->Look(LookAhead(0.01)).drawing;
  EXPECT_NE(view->Look(T).drawing, before);
}

TEST(RoomView, ThinGapsContinueWhatIsBehindTheRestStaysUnknown) {
  // A board stands 1 m before the wall; the scan left a gap of a few pixels of wall on its right, and nothing
  // is known right of y = -1.
  RoomModel room = Wall();
  room.positions = {{3, 3, 2},     {3, 0.35f, 2}, {3, 0.35f, -2}, {3, 3, -2},
                    {3, 0.24f, 2}, {3, -1, 2},    {3, -1, -2},    {3, 0.24f, -2}};
  room.uvs = {{0, 0}, {0.4f, 0}, {0.4f, 1}, {0, 1}, {0.5f, 0}, {0.6f, 0}, {0.6f, 1}, {0.5f, 1}};
  room.indices = {0, 2, 1, 0, 3, 2, 4, 6, 5, 4, 7, 6};
  for (const Eigen::Vector3f& p : {Eigen::Vector3f(2, 0.5f, 0.5f), Eigen::Vector3f(2, 0.2f, 0.5f),
                                   Eigen::Vector3f(2, 0.2f, -0.5f), Eigen::Vector3f(2, 0.5f, -0.5f)}) {
    room.positions.push_back(p);
    room.uvs.emplace_back(0.9f, 0.5f);
  }
  room.indices.insert(room.indices.end(), {8, 10, 9, 8, 11, 10});
  const Rig rig = SomeRig();
  auto view = RoomView::Create(rig, room);
  ASSERT_TRUE(view);
  RigidTransform T = LookAhead(0);
  T.translation().setZero();
  const RoomPrediction& seen = view->Look(T);
  auto pixel = [&](double x, double y) {
    const Eigen::Vector2d p = *rig.color.Project(T.inverse() * Eigen::Vector3d(x, y, 0));
    return cv::Point(static_cast<int>(std::lround(p.x())), static_cast<int>(std::lround(p.y())));
  };
  const cv::Point board = pixel(2, 0.3), gap = pixel(3, 0.27), unknown = pixel(3, -1.4);
  EXPECT_NEAR(seen.depth_m(board), 2, 0.001);
  EXPECT_NEAR(seen.depth_m(gap), 3, 0.01);
  EXPECT_EQ(seen.seen(gap / 2), RoomPrediction::kFilled);
  EXPECT_EQ(seen.depth_m(unknown), 0);
  EXPECT_EQ(seen.seen(unknown / 2), 0);
  EXPECT_EQ(seen.r(unknown / 2), 0);
}

}  // namespace
}  // namespace mixstage
