// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/tsai.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>

namespace mixstage {
namespace {

const PinholeCamera kCamera{
    .width = 640, .height = 480, .fx = 558.6, .fy = 540, .cx = 331, .cy = 232, .k1 = -0.2};
const PinholeCamera kSquare{
    .width = 640, .height = 480, .fx = 540, .fy = 540, .cx = 319.5, .cy = 239.5, .k1 = -0.2};

RigidTransform Pose(double turn_deg, double tilt_deg, const Eigen::Vector3d& t) {
  constexpr double kRad = 3.14159265358979 / 180;
  RigidTransform T = RigidTransform::Identity();
  T.linear() = (Eigen::AngleAxisd(turn_deg * kRad, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(tilt_deg * kRad, Eigen::Vector3d::UnitX()) *
                Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitZ()))
                   .toRotationMatrix();
  T.translation() = t;
  return T;
}

// A 9x7 grid of 0.1 m squares about the origin, bent by `depth` (0: a plane), far from the world's origin.
std::vector<PointInPicture> See(const PinholeCamera& camera, const RigidTransform& T_camera_target,
                                double depth, double noise_px = 0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, 1);
  std::vector<PointInPicture> points;
  for (int y = -3; y <= 3; ++y)
    for (int x = -4; x <= 4; ++x) {
      const Eigen::Vector3d p(0.1 * x, 0.1 * y, depth * ((x * 5 + y * 3) % 4));
      const auto pixel = camera.Project(T_camera_target * p);
      EXPECT_TRUE(pixel.has_value());
      points.push_back({p, *pixel + noise_px * Eigen::Vector2d(noise(random), noise(random))});
    }
  return points;
}

void ExpectPose(const RigidTransform& found, const RigidTransform& truth, double tolerance) {
  EXPECT_LT((found.matrix() - truth.matrix()).cwiseAbs().maxCoeff(), tolerance);
}

TEST(Tsai, FindsACameraExactlyFromPointsInSpace) {
  const RigidTransform T = Pose(25, -15, {0.05, 0.0, 1.3});
  const auto found = CalibrateTsai(See(kCamera, T, 0.08), 640, 480);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_FALSE(found->coplanar);
  EXPECT_TRUE(found->held.empty());
  EXPECT_LT(found->rms_px, 1e-6);
  EXPECT_NEAR(found->camera.fx, kCamera.fx, 1e-4);
  EXPECT_NEAR(found->camera.fy, kCamera.fy, 1e-4);
  EXPECT_NEAR(found->camera.cx, kCamera.cx, 1e-4);
  EXPECT_NEAR(found->camera.cy, kCamera.cy, 1e-4);
  EXPECT_NEAR(found->camera.k1, kCamera.k1, 1e-6);
  EXPECT_NEAR(found->sx, kCamera.fx / kCamera.fy, 1e-7);
  ExpectPose(found->T_camera_world, T, 1e-6);
}

// The plane stands anywhere in the world, its own z axis not the world's.
TEST(Tsai, FindsACameraExactlyFromAPlaneAndSaysWhatItKept) {
  const RigidTransform T = Pose(-30, 22, {0.1, -0.05, 1.1}), T_world_target = Pose(70, 40, {3, -2, 1});
  auto points = See(kSquare, T, 0);
  for (auto& point : points) point.p_world = T_world_target * point.p_world;
  const auto found = CalibrateTsai(points, 640, 480);
  ASSERT_TRUE(found) << found.error().message;
  EXPECT_TRUE(found->coplanar);
  ASSERT_FALSE(found->held.empty());
  EXPECT_EQ(found->held[0].substr(0, 7), "sx at 1");
  EXPECT_LT(found->rms_px, 1e-6);
  EXPECT_NEAR(found->camera.fy, kSquare.fy, 1e-4);
  EXPECT_NEAR(found->camera.k1, kSquare.k1, 1e-6);
  ExpectPose(found->T_camera_world, T * T_world_target.inverse(), 1e-6);
}

// Under a target straight below the camera's axis Tsai's own T_y is 0.
TEST(Tsai, NeedsNoOffsetFromTheAxis) {
  for (const double depth : {0.0, 0.08}) {
    const auto found = CalibrateTsai(See(kSquare, Pose(30, 0, {0, 0, 1.2}), depth), 640, 480);
    ASSERT_TRUE(found) << found.error().message;
    EXPECT_NEAR(found->camera.fy, kSquare.fy, 1e-3);
  }
}

// Errors of 60 noisy pictures over the standard deviations claimed: 1 within what 60 draws scatter (sd 9 %).
void ExpectHonestDeviations(const PinholeCamera& camera, double depth) {
  constexpr int kRuns = 60;
  const RigidTransform T = Pose(30, -20, {0.03, 0.02, 1.0});
  Eigen::Matrix<double, 6, 1> sum = Eigen::Matrix<double, 6, 1>::Zero();
  int with_centre = 0;
  for (int run = 0; run < kRuns; ++run) {
    const auto found = CalibrateTsai(See(camera, T, depth, 0.2, 100 + static_cast<unsigned>(run)), 640, 480);
    ASSERT_TRUE(found) << found.error().message;
    auto add = [&](int i, double error, double sd) {
      if (sd > 0) sum[i] += error * error / (sd * sd);
    };
    add(0, found->camera.fy - camera.fy, found->f_sd_px);
    add(1, found->camera.k1 - camera.k1, found->k1_sd);
    add(2, found->camera.cx - camera.cx, found->cx_sd_px);
    add(3, found->sx - camera.fx / camera.fy, found->sx_sd);
    const Eigen::AngleAxisd turn(Eigen::Matrix3d(found->T_camera_world.linear() * T.linear().transpose()));
    add(4, turn.angle() * turn.axis().y(), found->rotation_sd_rad.y());
    const double mean_height = 3 * depth / 2;
    add(5,
        (found->T_camera_world * Eigen::Vector3d(0, 0, mean_height) - T * Eigen::Vector3d(0, 0, mean_height))
            .z(),
        found->translation_sd.z());
    with_centre += found->cx_sd_px > 0;
  }
  for (int i = 0; i < 6; ++i) {
    if ((i == 2 && with_centre < kRuns) || (i == 3 && depth == 0)) continue;
    EXPECT_GT(std::sqrt(sum[i] / kRuns), 0.72) << i;
    EXPECT_LT(std::sqrt(sum[i] / kRuns), 1.3) << i;
  }
}

TEST(Tsai, StandardDeviationsAreThoseOfManyPictures) {
  ExpectHonestDeviations(kCamera, 0.08);
  ExpectHonestDeviations(kSquare, 0);
}

TEST(Tsai, RefusesWhatDeterminesNoCamera) {
  const RigidTransform T = Pose(30, 10, {0, 0, 1.2});
  auto few = See(kSquare, T, 0);
  few.resize(5);
  EXPECT_EQ(CalibrateTsai(few, 640, 480).error().code, ErrorCode::kBadInput);

  auto line = See(kSquare, T, 0);
  line.resize(9);
  EXPECT_EQ(CalibrateTsai(line, 640, 480).error().message, "the points lie in a line");

  auto nan = See(kSquare, T, 0);
  nan[7].pixel.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(CalibrateTsai(nan, 640, 480).error().message, "point 7 is not finite");

  for (const double noise_px : {0.0, 0.1, 0.3})
    for (const double tilt_deg : {0.0, 0.3}) {
      const auto parallel =
          CalibrateTsai(See(kSquare, Pose(0, tilt_deg, {0.05, 0, 1.2}), 0, noise_px), 640, 480);
      if (noise_px == 0 && tilt_deg > 0) continue;  // without any noise even this tells them apart
      ASSERT_FALSE(parallel) << noise_px << " px, " << tilt_deg << " deg: f " << parallel->camera.fy;
      EXPECT_EQ(parallel.error().code, ErrorCode::kQualityGate);
    }
}

}  // namespace
}  // namespace mixstage
