// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/color_evidence.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <random>

#include "server/segmentation/fusion.h"
#include "server/segmentation/tone_change.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

int WorstDifference(const cv::Mat1b& a, const cv::Mat1b& b) {
  int worst = 0;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) worst = std::max(worst, std::abs(a(y, x) - b(y, x)));
  }
  return worst;
}

TEST(ColorEvidence, SimdEqualsScalarAtEveryWidth) {
  for (int width = 16; width <= 134; ++width) {  // half widths 8..67
    FlatRoom room(width, 20, 3.0f);
    const BackgroundModel model = room.Learn(5);
    room.Shoot(0.9f);
    room.PaintColor({4, 4, 8, 10}, 20, 30, 160);
    const cv::Mat1f texture(Quarter(20), Quarter(width), 0.5f);
    const cv::Mat1b actor(Half(20), Half(width), 140);
    const ToneChange tone{{0.9f, 1.1f, 1.0f}, {1, -2, 0}};
    ColorEvidence scalar, simd;
    FindColorEvidenceScalar(room.picture, model, tone, {}, texture, actor, &scalar);
    FindColorEvidence(room.picture, model, tone, {}, texture, actor, &simd);
    // One step: the vector form rounds a sum of products once where the scalar rounds twice.
    ASSERT_LE(WorstDifference(scalar.room, simd.room), 1) << width;
    ASSERT_LE(WorstDifference(scalar.shadow, simd.shadow), 1) << width;
  }
}

TEST(Fusion, SimdEqualsScalarAtEveryWidth) {
  std::mt19937 random(5);
  for (int width = 1; width <= 67; ++width) {
    std::array<cv::Mat1b, 5> planes;
    for (cv::Mat1b& plane : planes) {
      plane.create(3, width);
      for (int i = 0; i < 3 * width; ++i)
        plane(i / width, i % width) = static_cast<std::uint8_t>(random() % 256);
    }
    const FusionInput input{planes[0], planes[1], planes[2], planes[3], planes[4], -0.5f, 8.0f};
    cv::Mat1b scalar, simd;
    FuseScalar(input, &scalar);
    Fuse(input, &simd);
    ASSERT_LE(WorstDifference(scalar, simd), 1) << width;
  }
}

class ColorEvidenceTest : public ::testing::Test {
 protected:
  ColorEvidenceTest() : room_(256, 192, 3.0f), model_(room_.Learn(20)) { room_.Shoot(); }
  ColorEvidence Find() {
    const cv::Mat1f texture(48, 64, 0.0f);
    ColorEvidence evidence;
    FindColorEvidence(room_.picture, model_, {}, {}, texture, cv::Mat1b(96, 128, kNoEvidence), &evidence);
    return evidence;
  }
  FlatRoom room_;
  BackgroundModel model_;
};

TEST_F(ColorEvidenceTest, EqualIsTheRoomAndAnotherColorIsNot) {
  room_.PaintColor({80, 40, 100, 120}, 20, 30, 160);
  const ColorEvidence evidence = Find();
  EXPECT_LT(evidence.room(4, 4), 64);
  EXPECT_EQ(evidence.room(50, 60), 255);
  EXPECT_GT(evidence.shadow(50, 60), 192);
}

TEST_F(ColorEvidenceTest, DarkenedRoomIsShadowAndNotTheRoom) {
  room_.Darken({80, 40, 100, 120}, 0.8f);
  const ColorEvidence evidence = Find();
  EXPECT_GT(evidence.room(50, 60), 192);
  EXPECT_LT(evidence.shadow(50, 60), 96);
}

TEST_F(ColorEvidenceTest, BrightenedRoomIsNoShadow) {
  room_.Darken({80, 40, 100, 120}, 1.3f);
  EXPECT_GT(Find().shadow(50, 60), 128);
}

TEST_F(ColorEvidenceTest, ToneChangeIsFoundBesideAnActor) {
  room_.Shoot(1.2f);
  room_.PaintColor({80, 40, 100, 120}, 20, 30, 160);
  const ToneChange tone = FindToneChange(room_.picture, model_.mean, cv::Mat1b());
  for (std::size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(tone.gain[c] * 110 + tone.offset[c], 132,
                1.5f);  // what matters is the value, not gain or offset
  }
}

}  // namespace
}  // namespace mixstage
