// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/edge_coverage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

#include "proto/base/srgb.h"
#include "proto/codec/yuv_image.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

constexpr int kWidth = 240, kHeight = 120;

// A dark coat before a bright wall; his outline leans, his coverage is known in every pixel.
class EdgeCoverageTest : public ::testing::Test {
 protected:
  EdgeCoverageTest() : truth_(kHeight, kWidth), bgr_(kHeight, kWidth), alpha_(kHeight, kWidth) {
    const SrgbTables& srgb = SrgbTables::Get();
    std::mt19937 random(3);
    std::normal_distribution<float> noise(0, 1.5f);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const float right_of_edge = static_cast<float>(x) - 100.3f - 0.23f * static_cast<float>(y);
        const float a = std::clamp(0.5f - right_of_edge / kSoft, 0.0f, 1.0f);
        truth_(y, x) = a;
        for (int c = 0; c < 3; ++c) {
          const float light =
              a * srgb.ToLinear(kCoat[c]) + (1 - a) * srgb.ToLinear(kWall[c]);  // light adds up, not levels
          const float level = static_cast<float>(srgb.ToSrgb(light)) + noise(random);
          bgr_(y, x)[2 - c] = cv::saturate_cast<std::uint8_t>(level);
        }
      }
    }
    YuvImage color = FromBgr(bgr_, ChromaLayout::k420);
    HalfRgb(color, &picture_);
    auto estimator = BackgroundEstimator::Create({}, kWidth, kHeight).value();
    const cv::Mat3b wall(kHeight, kWidth, cv::Vec3b(kWall[2], kWall[1], kWall[0]));
    HalfPicture empty;
    HalfRgb(FromBgr(wall, ChromaLayout::k420), &empty);
    for (int i = 0; i < 4; ++i) estimator.Add(empty, {});
    model_ = estimator.EstimateEmpty().value();
    // What evidence decides is a pixel too wide.
    mask_.create(picture_.r.size());
    for (int y = 0; y < mask_.rows; ++y) {
      for (int x = 0; x < mask_.cols; ++x)
        mask_(y, x) = truth_(2 * y, std::max(2 * x - 2, 0)) > 0.5f ? 255 : 0;
    }
    decided_ = mask_.clone();
    coverage_.Run(View(std::as_const(color.y)), picture_, model_, {}, &decided_, &mask_, View(alpha_));
  }

  static constexpr float kSoft = 3;  // px from nothing to all of him
  static constexpr std::uint8_t kCoat[] = {60, 40, 45}, kWall[] = {190, 180, 170};
  cv::Mat1f truth_;
  cv::Mat3b bgr_;
  HalfPicture picture_;
  BackgroundModel model_;
  cv::Mat1b mask_, decided_, alpha_;
  EdgeCoverage coverage_;
};

TEST_F(EdgeCoverageTest, FindsASoftOutlineBetweenThePixels) {
  double band_error = 0;
  int band = 0;
  for (int y = 8; y < kHeight - 8; ++y) {
    double covered = 0, true_cover = 0;
    for (int x = 60; x < 180; ++x) {
      covered += alpha_(y, x) / 255.0;
      true_cover += truth_(y, x);
      if (truth_(y, x) <= 0 || truth_(y, x) >= 1) continue;
      band_error += std::abs(alpha_(y, x) / 255.0 - truth_(y, x));
      ++band;
    }
    EXPECT_NEAR(covered, true_cover, 0.5) << y;
  }
  EXPECT_LT(band_error / band, 0.1);
}

TEST_F(EdgeCoverageTest, TheMaskFollowsTheOutline) {
  for (int y = 8; y < mask_.rows - 8; ++y) {
    for (int x = 4; x < mask_.cols - 4; ++x) {
      const float a = (truth_(2 * y, 2 * x) + truth_(2 * y + 1, 2 * x + 1)) / 2;
      if (a > 0.8f || a < 0.2f) {
        EXPECT_EQ(mask_(y, x), a > 0.5f ? 255 : 0) << x << " " << y;
      }
    }
  }
}

TEST_F(EdgeCoverageTest, ForegroundIsTheCoatWithoutTheWall) {
  for (int y = 8; y < kHeight - 8; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      if (alpha_(y, x) == 0 || alpha_(y, x) == 255) continue;
      for (int c = 0; c < 3; ++c) EXPECT_NEAR(coverage_.foreground()(y, x)[c], kCoat[c], 25) << x << " " << y;
    }
  }
}

}  // namespace
}  // namespace mixstage
