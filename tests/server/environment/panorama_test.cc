// SPDX-License-Identifier: Apache-2.0
#include "server/environment/panorama.h"

#include <gtest/gtest.h>

namespace mixstage {
namespace {

Panorama Wide(PanoramaShape shape) {
  return {.shape = shape,
          .width = 400,
          .height = 300,
          .azimuth_left_deg = 80,
          .azimuth_right_deg = -40,
          .elevation_top_deg = 50,
          .elevation_bottom_deg = -45};
}

TEST(Panorama, PixelsAndRaysAreEachOthersInverse) {
  Panorama whole{.width = 400, .height = 200};
  Panorama behind = Wide(PanoramaShape::kSpherical);
  behind.azimuth_left_deg = 250;  // across the seam of atan2
  behind.azimuth_right_deg = 100;
  for (const Panorama& p :
       {Wide(PanoramaShape::kSpherical), Wide(PanoramaShape::kCylindrical), whole, behind}) {
    ASSERT_TRUE(p.Validate()) << p.Validate().error().message;
    for (double v = 0.3; v < p.height - 0.5; v += 7.1) {
      for (double u = 0; u < p.width - 0.5; u += 9.7) {
        const Eigen::Vector3d ray = p.Ray(u, v);
        EXPECT_NEAR(ray.norm(), 1, 1e-12);
        const auto pixel = p.Pixel(2.5 * ray);
        ASSERT_TRUE(pixel) << u << " " << v;
        EXPECT_NEAR((*pixel - Eigen::Vector2d(u, v)).norm(), 0, 1e-8);
      }
    }
  }
}

TEST(Panorama, LooksWhereItsAnglesSay) {
  const Panorama p = Wide(PanoramaShape::kCylindrical);
  // The left edge is 80 degrees to the left of +x, toward +y.
  const Eigen::Vector3d left = p.Ray(-0.5, 100);
  EXPECT_NEAR(std::atan2(left.y(), left.x()) * 180 / 3.14159265358979, 80, 1e-9);
  EXPECT_GT(p.Ray(200, 0).z(), 0);
  EXPECT_LT(p.Ray(200, 299).z(), 0);
  EXPECT_FALSE(p.Pixel({-1, 0, 0}));
  EXPECT_FALSE(p.Pixel({0, 0, 1}));
  EXPECT_FALSE(p.Pixel({0, 0, 0}));
  EXPECT_FALSE(p.Pixel({1, 0, 2}));
}

}  // namespace
}  // namespace mixstage
