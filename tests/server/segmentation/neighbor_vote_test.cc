// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/neighbor_vote.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <random>

#include "server/segmentation/color_evidence.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

constexpr float kOwnWeight = 0.02f;

class NeighborVoteTest : public ::testing::Test {
 protected:
  NeighborVoteTest() : room_(256, 192, 3.0f), model_(room_.Learn(10)) { room_.Shoot(); }
  // Evidence of an actor (half size) that is right in two of three pixels.
  cv::Mat1b Noisy(cv::Rect actor) {
    cv::Mat1b evidence(96, 128);
    for (int y = 0; y < evidence.rows; ++y) {
      for (int x = 0; x < evidence.cols; ++x)
        evidence(y, x) = actor.contains({x, y}) == (random_() % 3 != 0) ? 160 : 96;
    }
    return evidence;
  }
  cv::Mat1b Run(const cv::Mat1b& evidence) {
    cv::Mat1b decision;
    vote_.Run(evidence, room_.picture, model_, {}, kOwnWeight, &decision);
    cv::threshold(decision, decision, kNoEvidence, 255, cv::THRESH_BINARY);
    return decision;
  }
  FlatRoom room_;
  BackgroundModel model_;
  NeighborVote vote_;
  std::mt19937 random_{11};
};

TEST_F(NeighborVoteTest, OutlineFallsOntoThePicturesContrast) {
  const cv::Rect actor(40, 20, 40, 50);
  room_.PaintColor({80, 40, 80, 100}, 20, 30, 160);
  cv::Mat1b truth(96, 128, std::uint8_t{0});
  truth(actor).setTo(255);
  EXPECT_LT(cv::countNonZero(Run(Noisy(actor)) != truth), 0.01 * actor.area());
}

// The set's checks are contrasts of the picture, yet no outline: lit or in shadow.
TEST_F(NeighborVoteTest, ContrastsOfTheRoomAreNoOutline) {
  room_.Darken({80, 40, 80, 100}, 0.6f);
  cv::Mat1b evidence(96, 128, std::uint8_t{100});
  evidence({60, 40, 3, 3}).setTo(200);
  EXPECT_EQ(cv::countNonZero(Run(evidence)), 0);
}

TEST_F(NeighborVoteTest, LonePixelsAreNoActor) {
  cv::Mat1b evidence(96, 128, std::uint8_t{64});
  for (int y = 5; y < 96; y += 10) {
    for (int x = 5; x < 128; x += 10) evidence(y, x) = 255;
  }
  EXPECT_EQ(cv::countNonZero(Run(evidence)), 0);
}

}  // namespace
}  // namespace mixstage
