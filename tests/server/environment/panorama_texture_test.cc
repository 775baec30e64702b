// SPDX-License-Identifier: Apache-2.0
#include "server/environment/panorama_texture.h"

#include <gtest/gtest.h>

namespace mixstage {
namespace {

Panorama Wide() {
  return {.shape = PanoramaShape::kSpherical,
          .width = 2000,
          .height = 1600,
          .azimuth_left_deg = 60,
          .azimuth_right_deg = -60,
          .elevation_top_deg = 48,
          .elevation_bottom_deg = -48};
}

// Two triangles of a wall at x = 2 m, their texture the panorama.
RoomModel Wall(const Panorama& panorama) {
  RoomModel room;
  room.positions = {{2, 1.5f, 1}, {2, -1.5f, 1}, {2, -1.5f, -1}, {2, 1.5f, -1}};
  for (const Eigen::Vector3f& p : room.positions) {
    const Eigen::Vector2d pixel = *panorama.Pixel(p.cast<double>());
    room.uvs.emplace_back((pixel.x() + 0.5) / panorama.width, (pixel.y() + 0.5) / panorama.height);
  }
  room.indices = {0, 2, 1, 0, 3, 2};
  room.texture_bgr = cv::Mat3b(panorama.height, panorama.width);
  return room;
}

double Area(const RoomModel& room) {
  double area = 0;
  for (std::size_t i = 0; i < room.indices.size(); i += 3) {
    const Eigen::Vector3f& a = room.positions[room.indices[i]];
    area +=
        0.5 * (room.positions[room.indices[i + 1]] - a).cross(room.positions[room.indices[i + 2]] - a).norm();
  }
  return area;
}

TEST(PanoramaTexture, LiesStraightAfterSplitting) {
  const Panorama panorama = Wide();
  RoomModel room = Wall(panorama);
  SplitForPanorama(panorama, room);
  ASSERT_TRUE(room.Validate());
  EXPECT_GT(room.triangle_count(), 50u);
  EXPECT_NEAR(Area(room), 6, 1e-4);  // nothing lost, nothing twice
  double worst = 0;
  for (std::size_t i = 0; i < room.indices.size(); i += 3) {
    Eigen::Vector3f p = Eigen::Vector3f::Zero();
    Eigen::Vector2f uv = Eigen::Vector2f::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      p += room.positions[room.indices[i + k]] / 3;
      uv += room.uvs[room.indices[i + k]] / 3;
    }
    const Eigen::Vector2d pixel = *panorama.Pixel(p.cast<double>());
    worst = std::max(worst, std::hypot(uv.x() * 2000.0 - 0.5 - pixel.x(), uv.y() * 1600.0 - 0.5 - pixel.y()));
  }
  EXPECT_LT(worst, 1.0);  // texels; 40 before
}

TEST(PanoramaTexture, AnotherTextureStaysAsItIs) {
  const Panorama panorama = Wide();
  RoomModel room = Wall(panorama);
  room.uvs = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  SplitForPanorama(panorama, room);
  EXPECT_EQ(room.triangle_count(), 2u);
}

}  // namespace
}  // namespace mixstage
