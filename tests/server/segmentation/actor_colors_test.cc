// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_colors.h"

#include <gtest/gtest.h>

#include "server/segmentation/color_evidence.h"

namespace mixstage {
namespace {

HalfPicture Plain(int r, int g, int b) {
  return {cv::Mat1b(40, 50, static_cast<std::uint8_t>(r)), cv::Mat1b(40, 50, static_cast<std::uint8_t>(g)),
          cv::Mat1b(40, 50, static_cast<std::uint8_t>(b))};
}

class ActorColorsTest : public ::testing::Test {
 protected:
  void Learn(const HalfPicture& picture, std::uint8_t core, std::uint8_t evidence) {
    colors_.Learn(picture, cv::Mat1b(40, 50, core), cv::Mat1b(40, 50, evidence));
  }
  int Rate(const HalfPicture& picture) {
    cv::Mat1b likelihood;
    colors_.Rate(picture, &likelihood);
    return likelihood(20, 20);
  }
  ActorColors colors_;
};

TEST_F(ActorColorsTest, NothingIsKnownBeforeAnActorCame) {
  EXPECT_EQ(Rate(Plain(200, 30, 30)), kNoEvidence);
  Learn(Plain(200, 30, 30), 0, 255);            // nowhere inside an actor
  Learn(Plain(200, 30, 30), 255, kNoEvidence);  // inside, but nothing says so
  EXPECT_EQ(Rate(Plain(200, 30, 30)), kNoEvidence);
}

TEST_F(ActorColorsTest, HisColorsSpeakForHimAndOthersAgainst) {
  Learn(Plain(200, 30, 30), 255, 255);
  EXPECT_GT(Rate(Plain(203, 28, 33)), kNoEvidence + 32);
  EXPECT_LT(Rate(Plain(30, 30, 200)), kNoEvidence - 16);
}

TEST_F(ActorColorsTest, ColorsThatHeTookOffFade) {
  Learn(Plain(200, 30, 30), 255, 255);
  for (int i = 0; i < 80; ++i) Learn(Plain(30, 200, 30), 255, 255);
  EXPECT_LT(Rate(Plain(200, 30, 30)), kNoEvidence);
}

}  // namespace
}  // namespace mixstage
