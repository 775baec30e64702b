// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/depth_packer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace mixstage {
namespace {

constexpr DepthRange kRange{1.0f, 6.0f};

// A wall at `far_m` and a body at `near_m` in the middle third; every 7th pixel unknown.
cv::Mat1f Scene(int width, int height, float near_m, float far_m) {
  cv::Mat1f depth(height, width);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      depth(y, x) = (x + 3 * y) % 7 == 0 ? 0 : x > width / 3 && x < 2 * width / 3 ? near_m : far_m;
    }
  }
  return depth;
}

TEST(PackDepth, IsTheCodeOfEveryPixelAtEveryWidth) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> metres(-1.0f, 9.0f);
  for (int width = 1; width <= 67; ++width) {
    cv::Mat1f storage(5, width + 3);  // a stride that is not the width
    for (float& z : storage) z = metres(random);
    storage(0, 0) = std::numeric_limits<float>::quiet_NaN();
    storage(1, 0) = std::numeric_limits<float>::infinity();
    storage(2, 0) = 0;
    const cv::Mat1f depth = storage(cv::Rect(0, 0, width, 5));
    Yuv10Image planes;
    PackDepth(View(depth), {}, {}, kRange, &planes);
    for (int y = 0; y < 5; ++y) {
      for (int x = 0; x < width; ++x) {
        // The packer multiplies in another order; a code may round to the other side.
        EXPECT_NEAR(planes.y(y, x), DepthToCode(depth(y, x), kRange), depth(y, x) > 0 ? 1 : 0) << depth(y, x);
      }
    }
    EXPECT_EQ(planes.cb.size(), cv::Size((width + 1) / 2, 3));
    EXPECT_EQ(cv::countNonZero(planes.cb), 0);
    EXPECT_EQ(cv::countNonZero(planes.cr != 128), 0);
  }
}

TEST(PackDepth, MillimetresGiveTheSameCodesAsMetres) {
  cv::Mat1w millimetres(1, 8000);
  cv::Mat1f metres(1, 8000);
  for (int x = 0; x < 8000; ++x) {
    millimetres(0, x) = static_cast<std::uint16_t>(x);
    metres(0, x) = static_cast<float>(x) * 0.001f;
  }
  Yuv10Image a, b;
  PackDepth(View(millimetres), {}, {}, kRange, &a);
  PackDepth(View(metres), {}, {}, kRange, &b);
  for (int x = 0; x < 8000; ++x) EXPECT_NEAR(a.y(0, x), b.y(0, x), 1) << x;
  EXPECT_EQ(a.y(0, 0), 0);
}

TEST(PackDepth, CoverageIsTheMeanOfFourAndLabelsAreKept) {
  for (const int size : {6, 7}) {  // 7: the last column and row stand for the missing ones
    const cv::Mat1f depth(size, size, 2.0f);
    cv::Mat1b alpha(size, size, std::uint8_t{0}), label(size, size, std::uint8_t{1});
    alpha(0, 0) = 255, alpha(0, 1) = 255, alpha(1, 0) = 100;
    alpha(size - 1, size - 1) = 200;
    label(2, 2) = 2;
    label(4, 4) = 255;
    Yuv10Image planes;
    PackDepth(View(depth), View(alpha), View(label), kRange, &planes);
    EXPECT_EQ(planes.cb(0, 0), 610);
    EXPECT_EQ(planes.cb(planes.cb.rows - 1, planes.cb.cols - 1), size == 6 ? 200 : 800);
    EXPECT_EQ(planes.cr(0, 0), 128);
    EXPECT_EQ(planes.cr(1, 1), 512);
    EXPECT_EQ(planes.cr(2, 2), 896);
  }
}

TEST(DepthRangeFit, HoldsTheSceneWithAMarginAndLittleMore) {
  DepthRangeFit fit = *DepthRangeFit::Create({});
  fit.Update(View(Scene(320, 240, 2.0f, 5.0f)));
  EXPECT_LT(fit.range().near_m, 2.0f);
  EXPECT_GT(fit.range().near_m, 1.7f);
  EXPECT_GT(fit.range().far_m, 5.0f);
  EXPECT_LT(fit.range().far_m, 5.9f);
}

TEST(DepthRangeFit, StaysWhileItHoldsTheSceneAndFollowsWhenItDoesNot) {
  DepthRangeFit fit = *DepthRangeFit::Create({});
  fit.Update(View(Scene(320, 240, 2.0f, 5.0f)));
  const DepthRange first = fit.range();
  fit.Update(View(Scene(320, 240, 1.95f, 5.1f)));
  EXPECT_EQ(fit.range(), first);
  fit.Update(View(Scene(320, 240, 1.0f, 5.0f)));  // nearer than it holds
  EXPECT_LT(fit.range().near_m, 1.0f);
  fit.Update(View(Scene(320, 240, 4.0f, 5.0f)));  // most codes wasted
  EXPECT_GT(fit.range().near_m, 2.5f);
}

TEST(DepthRangeFit, AFewWildPixelsDoNotWidenIt) {
  cv::Mat1f depth = Scene(320, 240, 2.0f, 5.0f);
  depth(4, 4) = 0.3f;
  depth(12, 12) = 40.0f;
  DepthRangeFit fit = *DepthRangeFit::Create({});
  fit.Update(View(depth));
  EXPECT_GT(fit.range().near_m, 1.7f);
  EXPECT_LT(fit.range().far_m, 5.9f);
}

TEST(DepthRangeFit, NothingKnownChangesNothingAndAFlatSceneStillGetsARange) {
  DepthRangeFit fit = *DepthRangeFit::Create({});
  const DepthRange before = fit.range();
  fit.Update(View(cv::Mat1f(240, 320, 0.0f)));
  EXPECT_EQ(fit.range(), before);
  fit.Update(View(cv::Mat1f(240, 320, std::numeric_limits<float>::infinity())));
  EXPECT_EQ(fit.range(), before);
  fit.Update(View(cv::Mat1w(240, 320, std::uint16_t{3000})));
  EXPECT_LT(fit.range().near_m, 3.0f);
  EXPECT_GT(fit.range().far_m, 3.0f);
  EXPECT_GT(fit.range().far_m, 1.4f * fit.range().near_m);
}

TEST(DepthRangeFit, LimitsHoldForScenesBeyondThem) {
  DepthRangeFit fit = *DepthRangeFit::Create({.nearest_m = 1.0f, .farthest_m = 4.0f});
  for (const float z : {0.01f, 3000.0f}) {
    fit.Update(View(cv::Mat1f(240, 320, z)));
    EXPECT_GE(fit.range().near_m, 1.0f) << z;
    EXPECT_LE(fit.range().far_m, 4.0f) << z;
    EXPECT_LT(fit.range().near_m, fit.range().far_m) << z;
  }
}

TEST(DepthRangeFit, ConfigurationIsCheckedByName) {
  const auto refused = DepthRangeFit::Create({.margin = -1});
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("margin"), std::string::npos);
  EXPECT_FALSE(DepthRangeFit::Create({.outlier_share = 0.5}));
  EXPECT_FALSE(DepthRangeFit::Create({.nearest_m = 0}));
}

}  // namespace
}  // namespace mixstage
