// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/depth_code.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace mixstage {
namespace {

constexpr DepthRange kRange{1.0f, 6.0f};

TEST(DepthCode, FollowsTheEquationOfTheSpecification) {
  for (const int code : {1, 2, 100, 512, 1000, 1022, 1023}) {
    const double inverse = 1 / 6.0 + (code - 1) / 1022.0 * (1 / 1.0 - 1 / 6.0);
    EXPECT_NEAR(CodeToDepth(code, kRange), 1 / inverse, 1e-6) << code;
  }
  EXPECT_FLOAT_EQ(CodeToDepth(1, kRange), 6.0f);
  EXPECT_FLOAT_EQ(CodeToDepth(1023, kRange), 1.0f);
}

TEST(DepthCode, EveryCodeComesBack) {
  for (int code = 0; code <= 1023; ++code) EXPECT_EQ(DepthToCode(CodeToDepth(code, kRange), kRange), code);
}

TEST(DepthCode, UnknownStaysUnknownAndDepthsBeyondTheRangeGetItsEnds) {
  EXPECT_EQ(DepthToCode(0, kRange), 0);
  EXPECT_EQ(DepthToCode(-1, kRange), 0);
  EXPECT_EQ(DepthToCode(std::numeric_limits<float>::quiet_NaN(), kRange), 0);
  EXPECT_EQ(DepthToCode(0.5f, kRange), 1023);
  EXPECT_EQ(DepthToCode(100, kRange), 1);
  EXPECT_EQ(DepthToCode(std::numeric_limits<float>::infinity(), kRange), 1);
  EXPECT_EQ(CodeToDepth(0, kRange), 0);
  EXPECT_EQ(CodeToDepth(-3, kRange), 0);
  EXPECT_EQ(CodeToDepth(4000, kRange), CodeToDepth(1023, kRange));
}

TEST(DepthCode, AnyRangeAMessageMayHoldGivesFiniteDepths) {
  const float tiny = std::numeric_limits<float>::denorm_min();
  for (int code = 0; code <= 1023; ++code) EXPECT_TRUE(std::isfinite(CodeToDepth(code, {tiny, 2 * tiny})));
}

TEST(AlphaCode, ComesBackForEveryAlphaAndSurvivesACodeOfNoise) {
  for (int alpha = 0; alpha <= 255; ++alpha) {
    const int code = AlphaToCode(static_cast<std::uint8_t>(alpha));
    EXPECT_EQ(CodeToAlpha(code), alpha);
    EXPECT_EQ(CodeToAlpha(code + 1), alpha);
    EXPECT_EQ(CodeToAlpha(code - 1), alpha);
  }
  EXPECT_EQ(CodeToAlpha(1023), 255);
}

TEST(LabelCode, IsTheNearestOfThree) {
  for (const WatchLabel label : {WatchLabel::kScene, WatchLabel::kShadow, WatchLabel::kUnknown}) {
    for (const int noise : {-190, 0, 190}) EXPECT_EQ(CodeToLabel(LabelToCode(label) + noise), label);
  }
  EXPECT_EQ(LabelPixelToCode(0), 128);
  EXPECT_EQ(LabelPixelToCode(1), 128);
  EXPECT_EQ(LabelPixelToCode(2), 512);
  EXPECT_EQ(LabelPixelToCode(255), 896);
}

}  // namespace
}  // namespace mixstage
