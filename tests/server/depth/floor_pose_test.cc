// SPDX-License-Identifier: Apache-2.0
#include "server/depth/floor_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>

namespace mixstage {
namespace {

const PinholeCamera kCamera{.width = 320, .height = 240, .fx = 280, .fy = 280, .cx = 160, .cy = 120};

// A floor, a wall 4 m ahead and a table, from 1.5 m over the floor; noise grows with the square of z. pitch
// and roll of the camera; without_floor: the wall alone.
cv::Mat1f Room(const Eigen::Vector3d& up, bool floor) {
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 0.003);
  cv::Mat1f depth(240, 320, 0.0f);
  const Eigen::Vector3d ahead = (Eigen::Vector3d::UnitZ() - up.z() * up).normalized();
  const Eigen::Vector3d left = up.cross(ahead);
  for (int v = 0; v < 240; ++v) {
    for (int u = 0; u < 320; ++u) {
      const Eigen::Vector3d ray = kCamera.Unproject(Eigen::Vector2d(u, v))->homogeneous();
      double z = 4 / std::max(1e-6, ray.dot(ahead));
      if (floor && ray.dot(up) < 0) {
        z = std::min(z, -1.5 / ray.dot(up));
        const double table = -0.8 / ray.dot(up);
        const Eigen::Vector3d p = table * ray;
        if (p.dot(ahead) > 1.5 && p.dot(ahead) < 3 && p.dot(left) > 0.1 && p.dot(left) < 1.3) z = table;
      }
      if (random() % 10 != 0) depth(v, u) = static_cast<float>(z + z * z * noise(random));
    }
  }
  return depth;
}

TEST(FloorPose, TheFloorIsBelowTheTable) {
  for (const double pitch : {0.15, 0.5}) {
    const Eigen::Vector3d up = Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitX()) *
                               (Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitZ()) * -Eigen::Vector3d::UnitY());
    const cv::Mat1f depth = Room(up, true);
    const auto seen = FindFloorBelow(View(depth), kCamera);
    ASSERT_TRUE(seen);
    EXPECT_LT(std::acos(std::min(1.0, seen->up.dot(up))) * 57.3, 0.3);
    EXPECT_NEAR(seen->height_m, 1.5, 0.01);
  }
}

TEST(FloorPose, AWallIsNone) {
  const cv::Mat1f wall = Room(-Eigen::Vector3d::UnitY(), false);
  EXPECT_FALSE(FindFloorBelow(View(wall), kCamera));
  const cv::Mat1f nothing(240, 320, 0.0f);
  EXPECT_FALSE(FindFloorBelow(View(nothing), kCamera));
}

}  // namespace
}  // namespace mixstage
