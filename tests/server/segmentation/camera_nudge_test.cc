// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/camera_nudge.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "server/segmentation/key.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

constexpr int kWidth = 512, kHeight = 384;

// A room of many sizes of patches before a camera that may stand a little elsewhere, px.
class CameraNudgeTest : public testing::Test {
 protected:
  CameraNudgeTest() {
    cv::Mat1f coarse(24, 32), fine(96, 128);
    cv::RNG random(3);
    random.fill(coarse, cv::RNG::UNIFORM, -40, 40);
    random.fill(fine, cv::RNG::UNIFORM, -25, 25);
    cv::resize(coarse, coarse, {kWidth, kHeight}, 0, 0, cv::INTER_CUBIC);
    cv::resize(fine, fine, {kWidth, kHeight}, 0, 0, cv::INTER_CUBIC);
    scene_ = 120 + coarse + fine;
    auto estimator = BackgroundEstimator::Create({}, kWidth, kHeight).value();
    const cv::Mat1f depth(kHeight, kWidth, 3.0f);
    for (int i = 0; i < 12; ++i) {
      Shoot({0, 0});
      estimator.Add(picture_, View(depth));
    }
    room_ = estimator.EstimateEmpty().value();
  }
  void Shoot(cv::Point2d nudge, const cv::Rect& actor = {}) {
    cv::Mat1f moved;
    cv::warpAffine(scene_, moved, cv::Matx23d(1, 0, nudge.x, 0, 1, nudge.y), scene_.size(), cv::INTER_LINEAR,
                   cv::BORDER_REFLECT);
    if (!actor.empty()) moved(actor).setTo(20);
    cv::resize(moved, moved, {kWidth / 2, kHeight / 2}, 0, 0, cv::INTER_AREA);
    for (cv::Mat1b* plane : {&picture_.r, &picture_.g, &picture_.b}) {
      cv::Mat1f noise(moved.size());
      random_.fill(noise, cv::RNG::NORMAL, 0, 1.5);
      noise += moved;
      noise.convertTo(*plane, CV_8U);
    }
  }
  std::optional<cv::Point2d> Look(cv::Point2d nudge, const cv::Rect& actor = {}) {
    for (int i = 0; i < 6 * CameraNudge::kEvery; ++i) {
      if (i % CameraNudge::kEvery == 0) Shoot(nudge, actor);
      if (const auto found = nudge_.See(picture_, room_)) return found;
    }
    return std::nullopt;
  }
  double ActorShare(const BackgroundModel& room) {
    cv::Mat1b label(kHeight, kWidth), alpha(kHeight, kWidth);
    const cv::Mat1b luma = LumaOf(picture_, kWidth, kHeight);
    Key key = Key::Create({}).value();  // whose actor wears none of the room's colours
    key.Run(room, View(luma), picture_, {}, 0, View(label), View(alpha));
    return cv::countNonZero(alpha >= 128) / static_cast<double>(alpha.total());
  }

  cv::Mat1f scene_;
  cv::RNG random_{5};
  HalfPicture picture_;
  BackgroundModel room_;
  CameraNudge nudge_;
};

TEST_F(CameraNudgeTest, ACameraThatStandsIsNotNudged) {
  EXPECT_FALSE(Look({0, 0}));
  EXPECT_FALSE(Look({0.5, 0.3}));
  EXPECT_FALSE(Look({0, 0}, {150, 60, 200, 320})) << "by an actor";
}

TEST_F(CameraNudgeTest, ByHowMuchIsToldBesideAnActorToo) {
  const auto found = Look({9, -5}, {150, 60, 160, 320});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->x, 9, 0.8);
  EXPECT_NEAR(found->y, -5, 0.8);
}

TEST_F(CameraNudgeTest, TheEmptySetIsMovedAlong) {
  const auto found = Look({9, -5});
  ASSERT_TRUE(found);
  const double before = ActorShare(room_);
  const BackgroundModel moved = MovedAlong(room_, *found);
  EXPECT_LT(ActorShare(moved), 0.002) << "before: " << before;
  EXPECT_GT(before, 0.02);
  EXPECT_EQ(moved.seen(100, 1), 0) << "what came into view";
}

TEST_F(CameraNudgeTest, ACoveredViewIsNoNudge) { EXPECT_FALSE(Look({0, 0}, {0, 0, kWidth, kHeight})); }

}  // namespace
}  // namespace mixstage
