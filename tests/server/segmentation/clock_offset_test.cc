// SPDX-License-Identifier: Apache-2.0
//
// A figure that walks to and fro before a wall, seen by colour at 30 pictures a second and by depth at 12.5,
// whose clock is wrong, whose grid is coarse and whose outline is too wide and beside the true one.
#include "server/segmentation/clock_offset.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <random>

namespace mixstage {
namespace {

constexpr int kWidth = 640, kHeight = 480;
constexpr float kWall_m = 4, kFigure_m = 3;

// Full-size pixels: a body and a swinging leg.
void Paint(cv::Mat1b& mask, double t_s, double grown, double beside) {
  mask.setTo(0);
  const double x = 320 + 200 * std::sin(0.9 * t_s) + beside;
  cv::ellipse(mask, cv::Point2d(x, 200), cv::Size2d(40 + grown, 120 + grown), 0, 0, 360, 255, -1);
  const double swing = 60 * std::sin(5 * t_s);
  cv::line(mask, cv::Point2d(x, 300), cv::Point2d(x + swing, 430), 255, static_cast<int>(30 + 2 * grown));
}

class ClockOffsetTest : public ::testing::Test {
 protected:
  ClockOffsetTest() {
    model_.width = kWidth;
    model_.height = kHeight;
    model_.room_depth_m = cv::Mat1f(Quarter(kHeight), Quarter(kWidth), kWall_m);
    model_.sigma_m = cv::Mat1f(Quarter(kHeight), Quarter(kWidth), 0.04f);
  }
  // depth's times are `wrong_s` late.
  void Show(double from_s, double to_s, double wrong_s, double speed = 1) {
    std::normal_distribution<float> noise(0, 0.04f);
    for (int i = static_cast<int>(from_s * 30); i < to_s * 30; ++i) {
      const double t_s = i / 30.0;
      const double depth_s = std::floor(t_s / 0.08 - 0.2) * 0.08;
      if (depth_s != depth_s_) {
        depth_s_ = depth_s;
        cv::Mat1b seen(kHeight, kWidth), coarse;
        Paint(seen, speed * depth_s, 3, 2);
        cv::resize(seen, coarse, {kWidth / 6, kHeight / 6}, 0, 0, cv::INTER_AREA);
        cv::resize(coarse, seen, seen.size(), 0, 0, cv::INTER_NEAREST);
        D_.create(kHeight, kWidth);
        for (int y = 0; y < kHeight; ++y) {
          for (int x = 0; x < kWidth; ++x)
            D_(y, x) = (seen(y, x) >= 128 ? kFigure_m : kWall_m) + noise(random_);
        }
      }
      cv::Mat1b full(kHeight, kWidth), mask;
      Paint(full, speed * t_s, 0, 0);
      cv::resize(full, mask, {Half(kWidth), Half(kHeight)}, 0, 0, cv::INTER_AREA);
      cv::threshold(mask, mask, 127, 255, cv::THRESH_BINARY);
      offset_.See(mask, std::llround(t_s * 1e6), View(std::as_const(D_)),
                  std::llround((depth_s + wrong_s) * 1e6), model_);
    }
  }
  ClockOffset offset_;
  BackgroundModel model_;
  cv::Mat1f D_;
  double depth_s_ = -1;
  std::mt19937 random_{3};
};

TEST_F(ClockOffsetTest, IsFoundWithinTwoMilliseconds) {
  for (const double wrong_s : {-0.03, 0.0, 0.012, 0.04}) {
    offset_ = ClockOffset();
    Show(0.5, 14, wrong_s);
    ASSERT_TRUE(offset_.estimate()) << wrong_s;
    EXPECT_NEAR(offset_.estimate()->offset_s, -wrong_s, 0.002);
    EXPECT_LT(offset_.estimate()->sigma_s, 0.002);
  }
}

TEST_F(ClockOffsetTest, AFigureWhoStandsTellsNothing) {
  Show(0.5, 14, 0.02, 0);
  EXPECT_FALSE(offset_.estimate());
}

TEST_F(ClockOffsetTest, AStepBackInTimeStartsAnew) {
  Show(0.5, 7, 0.02);
  Show(0.5, 14, 0.02);
  ASSERT_TRUE(offset_.estimate());
  EXPECT_NEAR(offset_.estimate()->offset_s, -0.02, 0.002);
}

}  // namespace
}  // namespace mixstage
