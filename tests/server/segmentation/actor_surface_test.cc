// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_surface.h"

#include <gtest/gtest.h>

#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

const cv::Rect kActor(160, 80, 120, 200);

class ActorSurfaceTest : public ::testing::Test {
 protected:
  ActorSurfaceTest() : room_(512, 384, 4.0f), model_(room_.Learn(12)), mask_(192, 256, std::uint8_t{0}) {
    room_.Shoot();
    mask_(cv::Rect(kActor.x / 2, kActor.y / 2, kActor.width / 2, kActor.height / 2)).setTo(255);
    room_.PaintDepth(kActor, 2.5f);
  }
  const cv::Mat1f& Run() {
    surface_.Run(mask_, room_.Depth(), model_);
    return surface_.depth_m();
  }
  [[nodiscard]] float At(int full_x, int full_y) const { return surface_.depth_m()(full_y / 2, full_x / 2); }
  FlatRoom room_;
  BackgroundModel model_;
  cv::Mat1b mask_;
  ActorSurface surface_ = ActorSurface::Create({}).value();
};

TEST_F(ActorSurfaceTest, IsCompleteInsideTheMatteAndZeroOutside) {
  room_.PaintDepth({190, 120, 40, 60}, 0);  // a hole
  const cv::Mat1f& z = Run();
  for (int y = 0; y < z.rows; ++y) {
    for (int x = 0; x < z.cols; ++x) {
      ASSERT_EQ(z(y, x) > 0, mask_(y, x) > 0) << x << "," << y;
      ASSERT_NEAR(z(y, x), mask_(y, x) > 0 ? 2.5f : 0.0f, 0.01f) << x << "," << y;
    }
  }
}

TEST_F(ActorSurfaceTest, WhereDepthDoesNotLookHeStandsOnTheFloorOrWhereHeWasLast) {
  // The floor under his feet, 3 m away, is known beside him alone; of him depth sees nothing.
  model_.room_depth_m(cv::Rect(30, 0, 50, 96)).setTo(0);
  model_.room_depth_m(cv::Rect(0, 68, 30, 6)).setTo(3.0f);
  room_.PaintDepth(kActor, 0);
  Run();
  EXPECT_NEAR(At(220, 180), 3.0f, 1e-3f);
  room_.PaintDepth({170, 90, 100, 180}, 2.2f);
  Run();
  EXPECT_NEAR(At(220, 180), 2.2f, 0.02f);
  room_.PaintDepth(kActor, 0);
  Run();
  EXPECT_NEAR(At(220, 180), 2.2f, 0.02f);
}

TEST_F(ActorSurfaceTest, DropsAFlyingPixel) {
  room_.PaintDepth({200, 160, 4, 4}, 3.4f);
  Run();
  EXPECT_NEAR(At(201, 161), 2.5f, 0.01f);
}

TEST_F(ActorSurfaceTest, TheWallThatLateDepthShowsInsideTheMatteIsNotHim) {
  room_.PaintDepth({160, 80, 30, 200}, 4.0f);
  Run();
  EXPECT_NEAR(At(166, 180), 2.5f, 0.02f);
}

TEST_F(ActorSurfaceTest, KeepsTheStepFromArmToBody) {
  room_.PaintDepth({160, 160, 120, 40}, 2.0f);
  Run();
  EXPECT_NEAR(At(220, 180), 2.0f, 0.02f);
  EXPECT_NEAR(At(220, 120), 2.5f, 0.02f);
}

TEST_F(ActorSurfaceTest, CalmsNoise) {
  FlatRoom noisy(512, 384, 2.5f);
  noisy.Shoot(1, 1.5f, 0.05f);
  noisy.depth(kActor).copyTo(room_.depth(kActor));
  // His noise is what the room's own noise says of the sensor.
  model_.sigma_m.setTo(0.12f);
  const cv::Mat1f& z = Run();
  cv::Scalar mean, deviation;
  cv::meanStdDev(z, mean, deviation, mask_);
  EXPECT_NEAR(mean[0], 2.5, 0.01);
  EXPECT_LT(deviation[0], 0.02);
}

// 1.25 m/s towards the camera; colour pictures 40 ms after the depth that they go with.
TEST_F(ActorSurfaceTest, OldDepthIsBroughtToThePicturesInstant) {
  float z_m = 2.8f;
  for (int i = 1; i <= 8; ++i, z_m -= 0.1f) {
    room_.PaintDepth(kActor, z_m);
    surface_.Run(mask_, room_.Depth(), model_, {.measured_us = i * 80'000, .age_s = 0.04});
  }
  EXPECT_NEAR(At(220, 180), z_m + 0.1f - 0.05f, 0.005f);
  surface_.Run(mask_, room_.Depth(), model_, {.measured_us = 8 * 80'000, .age_s = 0.0});
  EXPECT_NEAR(At(220, 180), z_m + 0.1f, 0.005f);
}

TEST_F(ActorSurfaceTest, NoDepthNoSurface) {
  surface_.Run(mask_, {}, model_);
  EXPECT_EQ(cv::countNonZero(surface_.depth_m()), 0);
}

}  // namespace
}  // namespace mixstage
