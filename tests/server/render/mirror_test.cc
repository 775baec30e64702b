// SPDX-License-Identifier: Apache-2.0
#include "server/render/mirror.h"

#include <gtest/gtest.h>

#include "server/render/spread.h"
#include "tests/server/render/test_scenes.h"

namespace mixstage {
namespace {

Reflector Floor(double height_m) {
  Reflector floor;
  floor.plane = {0, 0, 1, -height_m};
  return floor;
}

RigidTransform LooksDown() {
  RigidTransform T = RigidTransform::Identity();
  T.linear() =
      (Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(-1.9, Eigen::Vector3d::UnitX()) *
       Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitZ()))
          .toRotationMatrix();
  T.translation() = Eigen::Vector3d(0.3, -0.2, 1.6);
  return T;
}

TEST(Mirror, APointIsSeenWhereItsMirrorImageWouldBe) {
  for (const int width : {320, 321}) {
    PinholeCamera camera = test::DistortedCamera();
    camera.width = width;
    const RigidTransform T_scene_color = LooksDown();
    for (const bool turned : {false, true}) {
      Reflector floor = Floor(0.2);
      if (turned) floor.plane = -floor.plane;
      const auto view = ViewInto(floor, T_scene_color);
      ASSERT_TRUE(view);
      EXPECT_NEAR(view->T_scene_mirrored.linear().determinant(), 1, 1e-12);
      EXPECT_NEAR(view->plane.z(), 1, 1e-12);
      const PinholeCamera mirrored = MirroredCamera(camera);
      int seen = 0;
      for (double x = -1; x <= 1; x += 0.25) {
        const Eigen::Vector3d p(x - 0.6, 2.2, 0.2 + 0.3 + 0.2 * x), image(p.x(), p.y(), 0.4 - p.z());
        const auto direct = camera.Project(T_scene_color.inverse() * image);
        const auto in_mirror = mirrored.Project(view->T_scene_mirrored.inverse() * p);
        if (!direct) continue;
        ASSERT_TRUE(in_mirror);
        EXPECT_NEAR(mirrored.width - 1 - in_mirror->x(), (direct->x() + 0.5) / 2 - 0.5, 1e-9);
        EXPECT_NEAR(in_mirror->y(), (direct->y() + 0.5) / 2 - 0.5, 1e-9);
        EXPECT_NEAR((view->T_scene_mirrored.inverse() * p).z(), (T_scene_color.inverse() * image).z(), 1e-9);
        ++seen;
      }
      EXPECT_GT(seen, 4);
    }
  }
}

TEST(Mirror, ACameraInThePlaneSeesNoMirror) {
  EXPECT_FALSE(ViewInto(Floor(1.6), LooksDown()));
  EXPECT_TRUE(ViewInto(Floor(1.5), LooksDown()));
}

TEST(Mirror, TheWindowHoldsThePolygonAndNoMore) {
  const PinholeCamera camera = test::DistortedCamera();
  Reflector floor = Floor(0);
  floor.polygon = {{-0.8, 1.6, 0}, {-0.2, 1.6, 0}, {-0.2, 2.2, 0}, {-0.8, 2.2, 0}};
  const cv::Rect window = WindowOf(floor, LooksDown(), camera);
  cv::Rect2d box;
  for (const Eigen::Vector3d& corner : floor.polygon) {
    const auto pixel = camera.Project(LooksDown().inverse() * corner);
    ASSERT_TRUE(pixel);
    const cv::Rect2d at(pixel->x() / 2, pixel->y() / 2, 0.01, 0.01);
    box = box.empty() ? at : box | at;
  }
  EXPECT_LE(window.x, box.x);
  EXPECT_GE(window.br().y, box.br().y);
  EXPECT_NEAR(window.width, box.width, 6);
  EXPECT_NEAR(window.height, box.height, 6);
  for (Eigen::Vector3d& corner : floor.polygon) corner.y() -= 9;  // behind the camera
  EXPECT_TRUE(WindowOf(floor, LooksDown(), camera).empty());
}

TEST(Mirror, FresnelGoesFromTheReflectivityToAWholeMirror) {
  EXPECT_FLOAT_EQ(Fresnel(0.04, 0, 1), 0.04f);
  EXPECT_FLOAT_EQ(Fresnel(0.04, 0, 0), 1.0f);
  EXPECT_NEAR(Fresnel(0.04, 0, 0.5f), 0.04 + 0.96 / 32, 1e-6);
  EXPECT_FLOAT_EQ(Fresnel(0.04, 0.4, 0), 0.6f);  // rough
  EXPECT_FLOAT_EQ(Fresnel(0.9, 0.4, 0), 0.9f);
  EXPECT_EQ(Fresnel(0, 0, 0), 0.0f);
}

TEST(Mirror, PolygonsMayBeConcave) {
  Reflector floor = Floor(0);
  floor.polygon = {{0, 0, 0}, {2, 0, 0}, {2, 2, 0}, {1, 1, 0}, {0, 2, 0}};
  const PolygonTest polygon(floor);
  EXPECT_TRUE(polygon.Contains({0.2f, 1.5f, 0}));
  EXPECT_FALSE(polygon.Contains({1.0f, 1.5f, 0}));
  EXPECT_FALSE(polygon.Contains({2.5f, 0.5f, 0}));
}

TEST(Spread, KeepsTheLightAndIsAsWideAsAsked) {
  cv::Mat3f line(1, 101, cv::Vec3f::all(0));
  line(0, 50) = cv::Vec3f(1, 2, 3);
  Spread(SpreadAxis::kX, cv::Mat1f(1, 101, 6.0f), Beyond::kNothing, line);
  double sum = 0, variance = 0;
  for (int x = 0; x < 101; ++x) {
    sum += double{line(0, x)[1]};
    variance += double{line(0, x)[1]} * (x - 50) * (x - 50);
  }
  EXPECT_NEAR(sum, 2, 1e-4);
  EXPECT_NEAR(std::sqrt(variance / sum), 6, 0.3);
  cv::Mat3f even(9, 40, cv::Vec3f::all(0.5f));
  Spread(SpreadAxis::kY, cv::Mat1f(9, 40, 20.0f), Beyond::kMore, even);
  for (const cv::Vec3f& p : even) EXPECT_NEAR(p[0], 0.5f, 1e-5);
}

}  // namespace
}  // namespace mixstage
