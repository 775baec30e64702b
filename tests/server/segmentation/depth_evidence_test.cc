// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/depth_evidence.h"

#include <gtest/gtest.h>

#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

int KeyOnePixel(float room_depth_m, float sensor_depth_m, float sigma_m) {
  std::uint8_t mask = 7;
  DepthKey({&room_depth_m, 1, 1, 1}, {&sensor_depth_m, 1, 1, 1}, {&sigma_m, 1, 1, 1}, {&mask, 1, 1, 1});
  return mask;
}

TEST(DepthKey, FollowsEq1OnBothSidesOfSigma) {
  EXPECT_EQ(KeyOnePixel(3.00f, 2.89f, 0.10f), 255);
  EXPECT_EQ(KeyOnePixel(3.00f, 2.91f, 0.10f), 0);
  EXPECT_EQ(KeyOnePixel(3.00f, 3.50f, 0.10f), 0);
}

TEST(DepthKey, SensorHoleIsNeverForeground) {
  EXPECT_EQ(KeyOnePixel(3.00f, 0.0f, 0.10f), 0);
  EXPECT_EQ(KeyOnePixel(0.0f, 2.0f, 0.10f), 0);
}

class DepthEvidenceTest : public ::testing::Test {
 protected:
  DepthEvidenceTest() : room_(256, 192, 3.0f), model_(room_.Learn(20)) { room_.Shoot(); }
  void Run(float age_s) { evidence_.Run(room_.Depth(), age_s, model_, {}); }
  FlatRoom room_;
  BackgroundModel model_;
  DepthEvidence evidence_;
};

TEST_F(DepthEvidenceTest, RoomSpeaksAgainstAndActorForHimself) {
  room_.PaintDepth({80, 40, 100, 120}, 2.0f);
  Run(0);
  EXPECT_LT(evidence_.log_odds()(5, 5), -2);
  EXPECT_FLOAT_EQ(evidence_.log_odds()(25, 32), 5);
  EXPECT_FLOAT_EQ(evidence_.inside()(25, 32), 1);
}

TEST_F(DepthEvidenceTest, HoleSaysNothing) {
  room_.PaintDepth({80, 40, 100, 120}, 0.0f);
  Run(0);
  EXPECT_FLOAT_EQ(evidence_.log_odds()(25, 32), 0);
}

TEST_F(DepthEvidenceTest, ANarrowGapIsNotWhatLiesBesideIt) {
  room_.PaintDepth({80, 40, 100, 120}, 2.0f);
  room_.PaintDepth({120, 40, 12, 120}, 0.0f);
  Run(0);
  EXPECT_FLOAT_EQ(evidence_.log_odds()(25, 27), 5);
  EXPECT_LT(evidence_.log_odds()(25, 30), 3);
  EXPECT_LT(evidence_.log_odds()(25, 32), 3);
}

TEST_F(DepthEvidenceTest, FarBehindTheRoomSaysNothing) {
  room_.PaintDepth({80, 40, 100, 120}, 5.0f);
  Run(0);
  EXPECT_FLOAT_EQ(evidence_.log_odds()(25, 32), 0);
}

TEST_F(DepthEvidenceTest, OldDepthIsWeakNearItsOutline) {
  room_.PaintDepth({80, 40, 100, 120}, 2.0f);
  Run(0);
  const float fresh = evidence_.log_odds()(25, 22);
  Run(0.08f);
  EXPECT_LT(evidence_.log_odds()(25, 22), 0.8f * fresh);
}

}  // namespace
}  // namespace mixstage
