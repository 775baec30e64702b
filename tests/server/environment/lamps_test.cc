// SPDX-License-Identifier: Apache-2.0
#include "server/environment/lamps.h"

#include <gtest/gtest.h>

#include <numbers>

namespace mixstage {
namespace {

TEST(FormFactor, IsThatOfASmallPatchFarAwayAndNothingBehind) {
  RoomLamp lamp;
  lamp.center = {0, 0, 3};
  lamp.edge_u = {0.1, 0, 0};
  lamp.edge_v = {0, -0.1, 0};  // shines down
  const double expected = 0.01 / (std::numbers::pi * 9);
  EXPECT_NEAR(FormFactor(lamp, {0, 0, 0}, {0, 0, 1}), expected, 1e-3 * expected);
  EXPECT_EQ(FormFactor(lamp, {0, 0, 0}, {0, 0, -1}), 0);
  EXPECT_EQ(FormFactor(lamp, {0, 0, 4}, {0, 0, -1}), 0);
}

// A floor of even albedo under two clipped lamps in a ceiling, one three times as bright. The ceiling's own
// light on the floor is what their radiance is measured against.
TEST(FindLamps, PlaceAndRadianceShowInTheLightOnTheFloor) {
  Panorama panorama{.width = 720, .height = 360, .center = {0, 0, 1.2}};
  const PanoramaGrid grid(panorama);
  RoomLamp bright, dim;
  bright.center = {2, 1, 2.6};
  dim.center = {-2, -1, 2.6};
  bright.edge_u = dim.edge_u = {0.6, 0, 0};
  bright.edge_v = dim.edge_v = {0, -0.4, 0};
  const double radiance_bright = 9, radiance_dim = 3, albedo = 0.35, ceiling_light = 0.4;
  SurfaceNodes nodes;
  nodes.width = 720;
  nodes.height = 360;
  nodes.closed = true;
  DenseSurface dense{cv::Mat1f(360, 720, 0.f), cv::Mat1i(360, 720, -1)};
  cv::Mat4b color(360, 720, cv::Vec4b(0, 0, 0, 0));
  GrownPlane floor{.m = Eigen::Vector3d(0, 0, -1 / 1.2)}, ceiling{.m = Eigen::Vector3d(0, 0, 1 / 1.4)};
  for (int y = 0; y < 360; ++y) {
    for (int x = 0; x < 720; ++x) {
      const Eigen::Vector3f ray = grid.Ray(x, y);
      const bool down = ray.z() < 0;
      nodes.ray.push_back(ray);
      const Eigen::Vector3d m = down ? floor.m : ceiling.m;
      nodes.plane.push_back(m.cast<float>());
      nodes.room_plane.push_back(down ? 0 : 1);
      nodes.inverse_range.push_back(static_cast<float>(m.dot(ray.cast<double>())));
      if (std::abs(ray.z()) < 0.2f) continue;
      dense.inverse_range(y, x) = static_cast<float>(m.dot(ray.cast<double>()));
      dense.node(y, x) = y * 720 + x;
      const Eigen::Vector3d p =
          panorama.center + ray.cast<double>() / static_cast<double>(dense.inverse_range(y, x));
      double light = ceiling_light;
      if (down)
        light = albedo * (ceiling_light + radiance_bright * FormFactor(bright, p, {0, 0, 1}) +
                          radiance_dim * FormFactor(dim, p, {0, 0, 1}));
      for (const RoomLamp* lamp : {&bright, &dim}) {
        if (!down && std::abs(p.x() - lamp->center.x()) < 0.3 && std::abs(p.y() - lamp->center.y()) < 0.2)
          light = 1;
      }
      // Nothing came back from the dim one: what stands there for its range is the slab behind it.
      if (!down && light == 1 && p.x() < 0) {
        nodes.inverse_range.back() = 0;
        dense.inverse_range(y, x) *= 1.4f / 1.5f;
      }
      const double code = light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - 0.055;
      const auto level = cv::saturate_cast<std::uint8_t>(255 * code);
      color(y, x) = {level, level, level, 255};
    }
  }
  const std::vector<RoomLamp> lamps = FindLamps(color, dense, nodes, {floor, ceiling}, grid, {});
  ASSERT_EQ(lamps.size(), 2u);
  const bool first_is_bright = lamps[0].center.x() > 0;
  const RoomLamp &a = lamps[first_is_bright ? 0 : 1], &b = lamps[first_is_bright ? 1 : 0];
  EXPECT_LT((a.center - bright.center).norm(), 0.05);
  EXPECT_LT((b.center - dim.center).norm(), 0.05);
  EXPECT_NEAR(a.edge_u.norm() * a.edge_v.norm(), 0.24, 0.03);
  EXPECT_GT(a.edge_u.cross(a.edge_v).dot(Eigen::Vector3d(0, 0, -1)), 0) << "shines down";
  EXPECT_NEAR(a.intensity / radiance_bright, 1, 0.3);
  EXPECT_NEAR(b.intensity / radiance_dim, 1, 0.3);
  EXPECT_GT(a.color.minCoeff(), 0.97);
}

}  // namespace
}  // namespace mixstage
