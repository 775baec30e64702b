// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_stance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

namespace mixstage {
namespace {

// The front of an upright elliptic column of a person's size on the floor, seen from `height_m` with the head
// bent down and aside; with noise.
class ActorStanceTest : public testing::Test {
 protected:
  static constexpr double kHeight_m = 1.4;
  PinholeCamera camera_{.width = 320, .height = 240, .fx = 260, .fy = 260, .cx = 160, .cy = 120};
  RigidTransform T_world_color_ = RigidTransform::Identity();
  std::mt19937 random_{3};

  ActorStanceTest() {
    const Eigen::Vector3d up =
        Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX()) *
        (Eigen::AngleAxisd(0.08, Eigen::Vector3d::UnitZ()) * -Eigen::Vector3d::UnitY());
    T_world_color_ = PoseOver(up, kHeight_m);
  }
  static void Show(ActorStance& stance, const cv::Mat1f& depth) { stance.See(View(depth)); }
  cv::Mat1f See(double x, double y, double top_m) {
    cv::Mat1f depth(120, 160, 0.0f);
    std::normal_distribution<double> noise(0, 0.02);
    for (int v = 0; v < depth.rows; ++v) {
      for (int u = 0; u < depth.cols; ++u) {
        const auto ray = camera_.Unproject({2 * u + 0.5, 2 * v + 0.5});
        const Eigen::Vector3d from = T_world_color_.translation();
        const Eigen::Vector3d d = T_world_color_.linear() * ray->homogeneous();
        // (p - c)^T diag(1/a^2, 1/b^2) (p - c) = 1
        const Eigen::Array2d radii(0.14, 0.24);
        const Eigen::Array2d o = (from.head<2>().array() - Eigen::Array2d(x, y)) / radii,
                             e = d.head<2>().array() / radii;
        const double a = e.matrix().squaredNorm(), b = o.matrix().dot(e.matrix()),
                     c = o.matrix().squaredNorm() - 1;
        if (b * b < a * c) continue;
        const double z = (-b - std::sqrt(b * b - a * c)) / a;
        const double height = from.z() + z * d.z();
        if (z > 0 && height >= 0 && height <= top_m) depth(v, u) = static_cast<float>(z + noise(random_));
      }
    }
    return depth;
  }
};

TEST_F(ActorStanceTest, TheAxisOfSomebodyWhoStandsSaysWhereTheCameraIs) {
  ActorStance stance(camera_);
  for (int i = 0; i < 12; ++i) Show(stance, See(3.2 + 0.05 * i, -0.3 + 0.05 * i, 1.75));
  ASSERT_TRUE(stance.T_world_color());
  const Eigen::Vector3d up = stance.T_world_color()->linear().row(2), truth = T_world_color_.linear().row(2);
  EXPECT_LT(std::acos(up.dot(truth)) * 57.3, 1.5);
  EXPECT_NEAR(stance.T_world_color()->translation().z(), kHeight_m, 0.04);
}

TEST_F(ActorStanceTest, WhoeverIsCutOffOrLiesSaysNothing) {
  ActorStance stance(camera_);
  Show(stance, See(1.6, 0, 1.75));  // his feet are below the picture
  EXPECT_FALSE(stance.T_world_color());
  cv::Mat1f lying(120, 160, 0.0f);
  lying(cv::Rect(30, 60, 100, 12)).setTo(3.0f);
  Show(stance, lying);
  EXPECT_FALSE(stance.T_world_color());
}

}  // namespace
}  // namespace mixstage
