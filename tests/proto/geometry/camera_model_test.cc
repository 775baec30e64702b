// SPDX-License-Identifier: Apache-2.0
#include "proto/geometry/camera_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

PinholeCamera Strong() {
  return {.width = 640,
          .height = 480,
          .fx = 500,
          .fy = 505,
          .cx = 310,
          .cy = 245,
          .k1 = -0.25,
          .k2 = 0.1,
          .p1 = 1e-3,
          .p2 = -5e-4};
}
// A rational model as Azure-type cameras ship with.
PinholeCamera Rational() {
  return {.width = 1280,
          .height = 720,
          .fx = 612,
          .fy = 612,
          .cx = 639,
          .cy = 366,
          .k1 = 0.33,
          .k2 = -2.49,
          .p1 = -1.6e-4,
          .p2 = -1.3e-4,
          .k3 = 1.45,
          .k4 = 0.21,
          .k5 = -2.30,
          .k6 = 1.38};
}

TEST(PinholeCamera, UnprojectUndoesProjectEverywhereInThePicture) {
  for (const PinholeCamera& camera : {Strong(), Rational()}) {
    for (int v = 0; v < camera.height; v += 7) {
      for (int u = 0; u < camera.width; u += 7) {
        const auto ray = camera.Unproject({u, v});
        ASSERT_TRUE(ray) << u << " " << v;
        const auto pixel = camera.Project({2 * ray->x(), 2 * ray->y(), 2});
        ASSERT_TRUE(pixel);
        ASSERT_NEAR(pixel->x(), u, 1e-6);
        ASSERT_NEAR(pixel->y(), v, 1e-6);
      }
    }
  }
}

TEST(PinholeCamera, NothingBehindTheCameraOrBeyondTheFoldHasAPixel) {
  const PinholeCamera camera = Strong();
  EXPECT_FALSE(camera.Project({0, 0, -1}));
  EXPECT_FALSE(camera.Project({0, 0, 0}));
  PinholeCamera barrel = camera;
  barrel.k2 = 0;  // r (1 - 0.25 r^2) rises up to r^2 = 4/3
  EXPECT_NEAR(barrel.FoldRadiusSquared(), 4.0 / 3, 0.03);
  EXPECT_TRUE(barrel.Project({1.1, 0, 1}));
  EXPECT_FALSE(barrel.Project({1.3, 0, 1}));
}

TEST(PinholeCamera, BadNumbersAreRefusedByName) {
  auto refused = [](auto change, const char* field) {
    PinholeCamera camera = Strong();
    change(camera);
    const Status status = camera.Validate();
    ASSERT_FALSE(status) << field;
    EXPECT_NE(status.error().message.find(field), std::string::npos) << status.error().message;
  };
  refused([](PinholeCamera& c) { c.fx = 0; }, "fx");
  refused([](PinholeCamera& c) { c.k2 = std::nan(""); }, "k2");
  refused([](PinholeCamera& c) { c.width = 100'000; }, "width");
}

TEST(UnprojectionTable, HoldsTheRayOfEveryPixelCentre) {
  const PinholeCamera camera = Strong();
  const cv::Mat2f table = UnprojectionTable(camera);
  const auto ray = camera.Unproject({17, 333});
  EXPECT_NEAR(table(333, 17)[0], ray->x(), 1e-6);
  EXPECT_NEAR(table(333, 17)[1], ray->y(), 1e-6);
}

TEST(FisheyeCamera, SeesBehindNinetyDegreesAndComesBack) {
  const FisheyeCamera camera{
      .width = 640, .height = 640, .fx = 186, .fy = 186, .cx = 323, .cy = 317, .k1 = 0.012, .k2 = -0.006};
  for (double deg = 0; deg <= 94; deg += 2) {
    const double theta = deg * std::numbers::pi / 180;
    const Eigen::Vector3d ray(std::sin(theta) * 0.6, std::sin(theta) * 0.8, std::cos(theta));
    const auto pixel = camera.Project(3 * ray);
    ASSERT_TRUE(pixel) << deg;
    const auto back = camera.Unproject(*pixel);
    ASSERT_TRUE(back);
    ASSERT_NEAR((*back - ray).norm(), 0, 1e-9) << deg;
  }
  EXPECT_FALSE(camera.Project({1, 0, -0.2}));  // 101 degrees
}

}  // namespace
}  // namespace mixstage
