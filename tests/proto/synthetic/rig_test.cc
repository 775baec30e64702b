// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/rig.h"

#include <gtest/gtest.h>

#include <cmath>

#include "proto/synthetic/room_plan.h"

namespace mixstage {
namespace {

void ExpectSame(const char* name, const Rig& code) {
  const auto loaded = LoadRig(std::string(MIXSTAGE_SOURCE_DIR) + "/deploy/demo/" + name);
  ASSERT_TRUE(loaded.has_value()) << loaded.error().message;
  EXPECT_TRUE(loaded->warnings.empty()) << loaded->warnings.front();
  const Rig& file = loaded->rig;
  EXPECT_EQ(file.color, code.color);
  EXPECT_EQ(file.vignetting_a, code.vignetting_a);
  EXPECT_EQ(file.vignetting_b, code.vignetting_b);
  ASSERT_TRUE(file.depth.has_value());
  EXPECT_EQ(file.depth->camera, code.depth->camera);
  EXPECT_EQ(file.depth->measures, code.depth->measures);
  EXPECT_EQ(file.depth->unit_m, code.depth->unit_m);
  EXPECT_EQ(file.depth->unambiguous_range_m, code.depth->unambiguous_range_m);
  EXPECT_EQ(file.depth->range_error, code.depth->range_error);
  EXPECT_TRUE(file.T_color_depth.isApprox(code.T_color_depth, 1e-9));
  ASSERT_TRUE(file.fisheye.has_value());
  FisheyeCamera fisheye = *file.fisheye;
  EXPECT_NEAR(fisheye.max_angle_rad, code.fisheye->max_angle_rad, 1e-9);
  fisheye.max_angle_rad = code.fisheye->max_angle_rad;
  EXPECT_EQ(fisheye, *code.fisheye);
  EXPECT_TRUE(file.T_color_fisheye.isApprox(code.T_color_fisheye, 1e-9));
  EXPECT_EQ(file.registered, code.registered);
  ASSERT_TRUE(file.ptu.has_value());
  for (const double pan_deg : {0.0, 30.0}) {
    EXPECT_TRUE(file.ptu->TWorldColor(pan_deg, -5).isApprox(code.ptu->TWorldColor(pan_deg, -5), 1e-9));
  }
}

TEST(SyntheticRig, IsTheDemonstrationsRigFile) {
  ExpectSame("rig.json", SyntheticRig());
  ExpectSame("nominal.json", SyntheticNominalRig());
}

TEST(SyntheticRig, StartsCalibrationNearTheTruthButNotAtIt) {
  const Rig nominal = SyntheticNominalRig();
  const Rig truth = SyntheticRig();
  EXPECT_NEAR(nominal.color.fx / truth.color.fx, 1, 0.03);
  EXPECT_GT(std::abs(nominal.color.fx / truth.color.fx - 1), 0.005);
  const Eigen::Vector3d nominal_axis = nominal.ptu->TWorldColor(25, 10).linear().col(2);
  const Eigen::Vector3d true_axis = truth.ptu->TWorldColor(25, 10).linear().col(2);
  EXPECT_LT(std::acos(nominal_axis.dot(true_axis)) * 180 / M_PI, 1.5);
  EXPECT_GT(std::acos(nominal_axis.dot(true_axis)) * 180 / M_PI, 0.1);
}

TEST(SyntheticRig, LooksDownIntoTheRoomFromEyeHeight) {
  const RigidTransform T_world_color = SyntheticTWorldColor(SyntheticRig());
  EXPECT_NEAR(T_world_color.translation().z(), 1.45, 0.06);
  const Eigen::Vector3d axis = T_world_color.linear().col(2);
  EXPECT_GT(axis.x(), 0.9);
  EXPECT_LT(axis.z(), -0.1);
  EXPECT_GT(axis.z(), -0.3);
}

TEST(SyntheticRig, AHeadOutsideTheRoomIsPutAtTheDemonstrationsPlace) {
  const Rig rig = SyntheticRig();
  Rig stray = rig;
  stray.ptu->T_world_base.translation() = Eigen::Vector3d(20, 0, 0);
  Rig none = rig;
  none.ptu.reset();
  for (const Rig& other : {stray, none}) {
    EXPECT_TRUE(SyntheticTWorldColor(other).isApprox(SyntheticTWorldColor(rig)));
  }
  Rig moved = rig;
  moved.ptu->T_world_base.translation() = Eigen::Vector3d(0.5, 0, 1.1);
  EXPECT_FALSE(SyntheticTWorldColor(moved).isApprox(SyntheticTWorldColor(rig)));
}

TEST(RoomPlan, SpotsForObjectsAreOnThePictureWithTheirSurroundings) {
  const Rig rig = SyntheticRig();
  const RigidTransform T_color_world = SyntheticTWorldColor(rig).inverse();
  for (const Eigen::Vector3d& spot : {room_plan::kNearSpot, room_plan::kFarSpot}) {
    for (const double z : {0.0, 0.9}) {
      for (const double y : {-0.28, 0.28}) {
        const auto pixel =
            rig.color.Project(T_color_world * Eigen::Vector3d(spot + Eigen::Vector3d(0, y, z)));
        ASSERT_TRUE(pixel.has_value());
        EXPECT_TRUE(pixel->x() > 0 && pixel->x() < 1023 && pixel->y() > 0 && pixel->y() < 767)
            << pixel->transpose();
      }
    }
  }
}

}  // namespace
}  // namespace mixstage
