// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/background_estimator.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

TEST(BackgroundEstimator, MeanIsEq1AndSigmaIsEq2) {
  auto estimator = BackgroundEstimator::Create({}, 64, 64).value();
  HalfPicture picture{cv::Mat1b(32, 32), cv::Mat1b(32, 32), cv::Mat1b(32, 32)};
  for (const int level : {90, 100, 110, 120}) {  // mean 105, sigma 11.18
    picture.r.setTo(level);
    picture.g.setTo(50);
    picture.b.setTo(level);
    estimator.Add(picture, {});
  }
  const BackgroundModel model = estimator.EstimateEmpty().value();
  EXPECT_FLOAT_EQ(model.mean[0](5, 5), 105);
  EXPECT_NEAR(std::sqrt(model.variance[0](5, 5)), 11.18f, 0.01f);
  EXPECT_GE(model.variance[1](5, 5), 0.64f);  // a still channel keeps the sensor's floor
  EXPECT_FALSE(model.has_depth());
}

TEST(BackgroundEstimator, DepthSigmaIsTheNoiseThatWasMeasured) {
  FlatRoom room(128, 96, 3.0f);
  auto estimator = BackgroundEstimator::Create({}, 128, 96).value();
  for (int i = 0; i < 30; ++i) {
    room.Shoot(1, 1.5f, 0.05f);
    estimator.Add(room.picture, room.Depth());
  }
  const BackgroundModel model = estimator.EstimateEmpty().value();
  EXPECT_NEAR(model.room_depth_m(10, 10), 3.0f, 0.05f);
  EXPECT_NEAR(cv::mean(model.sigma_m)[0], 0.052, 0.008);  // 50 mm and the 13.5 mm floor at 3 m
}

TEST(BackgroundEstimator, RarelyMeasuredPixelsAreNotKnown) {
  FlatRoom room(64, 64, 3.0f);
  auto estimator = BackgroundEstimator::Create({}, 64, 64).value();
  for (int i = 0; i < 10; ++i) {
    room.Shoot();
    if (i > 0) room.PaintDepth({0, 0, 32, 64}, 0);
    estimator.Add(room.picture, room.Depth());
  }
  const BackgroundModel model = estimator.EstimateEmpty().value();
  EXPECT_EQ(model.room_depth_m(8, 2), 0);
  EXPECT_GT(model.room_depth_m(8, 12), 2.9f);
}

TEST(BackgroundEstimator, RobustEstimateSeesThroughAnActorWhoStandsThereInTwoOfFiveSamples) {
  FlatRoom room(128, 96, 3.0f);
  auto estimator = BackgroundEstimator::Create({}, 128, 96).value();
  for (int i = 0; i < 20; ++i) {
    room.Shoot();
    if (i >= 12) {
      room.PaintColor({32, 16, 32, 64}, 20, 30, 160);
      room.PaintDepth({32, 16, 32, 64}, 2.0f);
    }
    estimator.Add(room.picture, room.Depth());
  }
  const BackgroundModel model = estimator.EstimateRobust().value();
  EXPECT_NEAR(model.room_depth_m(12, 12), 3.0f, 0.03f);
  EXPECT_GT(model.mean[0](24, 24), 90);
  EXPECT_LT(model.mean[2](24, 24), 130);
}

TEST(BackgroundEstimator, RobustEstimateSurvivesAutoExposure) {
  FlatRoom room(128, 96, 3.0f);
  auto estimator = BackgroundEstimator::Create({}, 128, 96).value();
  for (int i = 0; i < 21; ++i) {
    room.Shoot(i % 3 == 0 ? 0.85f : i % 3 == 1 ? 1.0f : 1.15f);
    estimator.Add(room.picture, room.Depth());
  }
  const BackgroundModel model = estimator.EstimateRobust().value();
  EXPECT_LT(std::sqrt(cv::mean(model.variance[1])[0]), 4.0);  // 15 levels without the tone change
}

TEST(BackgroundEstimator, StillIsNotEmptyAndEmptyAgreesWithTheTake) {
  FlatRoom room(128, 96, 3.0f);
  auto sitting = BackgroundEstimator::Create({}, 128, 96).value();
  auto moving = BackgroundEstimator::Create({}, 128, 96).value();
  for (int i = 0; i < 6; ++i) {
    room.Shoot();
    room.PaintColor({40, 20, 40, 60}, 20, 30, 160);
    sitting.Add(room.picture, room.Depth());
    room.Shoot();
    room.PaintColor({10 * i, 20, 40, 60}, 20, 30, 160);
    moving.Add(room.picture, room.Depth());
  }
  EXPECT_TRUE(sitting.IsStill());
  EXPECT_FALSE(moving.IsStill());
  EXPECT_FALSE(sitting.Agrees(room.Learn(10)));
}

TEST(BackgroundEstimator, KeepsABoundedStoreSpreadOverTheTake) {
  auto estimator = BackgroundEstimator::Create({.max_samples = 8}, 32, 32).value();
  FlatRoom room(32, 32, 3.0f);
  room.Shoot();
  for (int i = 0; i < 1000; ++i) {
    estimator.Add(room.picture, {});
    ASSERT_LE(estimator.size(), 8);
  }
  EXPECT_GE(estimator.size(), 4);
}

TEST(BackgroundEstimator, RefusesBadConfigurationAndMissingSamples) {
  EXPECT_FALSE(BackgroundEstimator::Create({}, 0, 480).has_value());
  EXPECT_FALSE(BackgroundEstimator::Create({.max_samples = 0}, 640, 480).has_value());
  auto estimator = BackgroundEstimator::Create({}, 640, 480).value();
  EXPECT_FALSE(estimator.EstimateEmpty().has_value());
  EXPECT_FALSE(estimator.EstimateRobust().has_value());
}

}  // namespace
}  // namespace mixstage
