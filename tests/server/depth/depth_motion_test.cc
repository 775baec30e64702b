// SPDX-License-Identifier: Apache-2.0
#include "server/depth/depth_motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace mixstage {
namespace {

constexpr float kWall_m = 4, kActor_m = 2;
constexpr std::int64_t kFrameUs = 33'333;

// A textured wall and a textured actor before it, who is where his left upper corner is.
class DepthMotionTest : public ::testing::Test {
 protected:
  DepthMotionTest() : wall_(480, 640), cloth_(200, 120) {
    std::mt19937 random(3);
    for (cv::Mat1b* texture : {&wall_, &cloth_}) {
      for (int y = 0; y < texture->rows; y += 8) {
        for (int x = 0; x < texture->cols; x += 8) {
          const cv::Rect cell = cv::Rect(x, y, 8, 8) & cv::Rect({0, 0}, texture->size());
          (*texture)(cell).setTo(static_cast<int>(random() % 100) + (texture == &wall_ ? 100 : 20));
        }
      }
    }
  }
  [[nodiscard]] static cv::Rect At(cv::Point corner) { return {corner.x, corner.y, 120, 200}; }
  [[nodiscard]] cv::Mat1b Picture(cv::Point corner) const {
    cv::Mat1b picture = wall_.clone();
    cloth_.copyTo(picture(At(corner)));
    return picture;
  }
  [[nodiscard]] static cv::Mat1f Depth(cv::Point corner) {
    cv::Mat1f depth(480, 640, kWall_m);
    depth(At(corner)).setTo(kActor_m);
    return depth;
  }
  // Share of a rectangle whose depth is z_m.
  [[nodiscard]] double Share(cv::Rect where, float z_m) const {
    return cv::countNonZero(moved_(where) == z_m) / static_cast<double>(where.area());
  }
  cv::Mat1b wall_, cloth_;
  DepthMotion motion_;
  cv::Mat1f moved_;
};

TEST_F(DepthMotionTest, ActorTakesHisDepthAlong) {
  const cv::Point then(200, 120), now(248, 112);  // 1.5 m/s at 3 m over 80 ms is about 50 px
  motion_.See(Picture(then), 0);
  motion_.See(Picture({224, 116}), kFrameUs);
  motion_.See(Picture(now), 2 * kFrameUs);
  const cv::Mat1f depth = Depth(then);
  const double age_s = motion_.Run(View(depth), 0, {}, &moved_);
  EXPECT_LT(age_s, 2e-6 * kFrameUs);
  EXPECT_GT(Share(At(now), kActor_m), 0.97);
  EXPECT_LT(Share({205, 130, 40, 180}, kActor_m), 0.03);  // where he was: the wall, or unknown
  EXPECT_EQ(Share({400, 0, 240, 480}, kWall_m), 1);
}

TEST_F(DepthMotionTest, BetweenTwoPicturesTheMotionIsShared) {
  motion_.See(Picture({200, 120}), 0);
  motion_.See(Picture({248, 120}), 2 * kFrameUs);
  const cv::Mat1f depth = Depth({216, 120});  // a third of the way
  motion_.Run(View(depth), 2 * kFrameUs / 3, {}, &moved_);
  EXPECT_GT(Share(At({248, 120}), kActor_m), 0.97);
}

TEST_F(DepthMotionTest, WhatStandsKeepsItsDepth) {
  for (int i = 0; i < 3; ++i) motion_.See(Picture({200, 120}), i * kFrameUs);
  const cv::Mat1f depth = Depth({200, 120});
  motion_.Run(View(depth), 0, {}, &moved_);
  EXPECT_EQ(cv::norm(moved_, depth, cv::NORM_INF), 0);
}

// What he uncovers resembles some other place of the room: a floor has no new depth for that.
TEST_F(DepthMotionTest, TheRoomDoesNotMove) {
  cv::Mat1f floor_m(480, 640), room_m(120, 160), sigma_m(120, 160, 0.02f);
  for (int y = 0; y < 480; ++y) floor_m.row(y).setTo(5 - 0.005f * static_cast<float>(y));
  for (int y = 0; y < 120; ++y) room_m.row(y).setTo(floor_m(4 * y + 1, 0));
  for (int y = 40; y < 480; ++y) wall_.row(y - 40).copyTo(wall_.row(y));  // a pattern that comes again
  const cv::Point then(200, 120), now(248, 112);
  motion_.See(Picture(then), 0);
  motion_.See(Picture(now), kFrameUs);
  cv::Mat1f depth = floor_m.clone();
  depth(At(then)).setTo(kActor_m);
  motion_.Run(View(depth), 0, {View(room_m), View(sigma_m)}, &moved_);
  EXPECT_GT(Share(At(now), kActor_m), 0.95);
  int wrong = 0;
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      const float z = moved_(y, x);
      wrong += z > 0 && z != kActor_m && std::abs(z - floor_m(y, x)) > 0.1f ? 1 : 0;
    }
  }
  EXPECT_EQ(wrong, 0);
}

TEST_F(DepthMotionTest, DepthFromBeforeThePicturesStaysAndIsOld) {
  motion_.See(Picture({200, 120}), 400'000);
  motion_.See(Picture({248, 120}), 433'333);
  const cv::Mat1f depth = Depth({200, 120});
  EXPECT_NEAR(motion_.Run(View(depth), 0, {}, &moved_), 0.4333, 1e-3);
  EXPECT_EQ(cv::norm(moved_, depth, cv::NORM_INF), 0);
}

TEST_F(DepthMotionTest, AnotherSizeOrAnEarlierTimeStartsAnew) {
  motion_.See(Picture({200, 120}), kFrameUs);
  motion_.See(cv::Mat1b(51, 101, std::uint8_t{90}), 2 * kFrameUs);
  const cv::Mat1f small(51, 101, kWall_m);
  motion_.Run(View(small), kFrameUs, {}, &moved_);
  EXPECT_EQ(cv::norm(moved_, small, cv::NORM_INF), 0);
  motion_.See(cv::Mat1b(51, 101, std::uint8_t{120}), kFrameUs);
  motion_.Run(View(small), 0, {}, &moved_);
  EXPECT_EQ(cv::norm(moved_, small, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace mixstage
