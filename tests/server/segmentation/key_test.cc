// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/key.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

const cv::Rect kActor(160, 80, 120, 200);

class KeyTest : public ::testing::Test {
 protected:
  KeyTest() : room_(512, 384, 3.0f), model_(room_.Learn(12)), key_(Key::Create({}).value()) { room_.Shoot(); }
  void Run(ImageView<const float> depth) {
    label_.create(model_.height, model_.width);
    alpha_.create(model_.height, model_.width);
    key_.Run(model_, room_.Luma(), room_.picture, depth, 0, View(label_), View(alpha_));
  }
  [[nodiscard]] double Share(cv::Rect where, int label) const {
    cv::Mat same;
    cv::compare(label_(where), label, same, cv::CMP_EQ);
    return cv::countNonZero(same) / static_cast<double>(where.area());
  }
  FlatRoom room_;
  BackgroundModel model_;
  Key key_;
  cv::Mat1b label_, alpha_;
};

TEST_F(KeyTest, EmptyRoomIsEmpty) {
  Run(room_.Depth());
  EXPECT_EQ(cv::countNonZero(alpha_), 0);
}

TEST_F(KeyTest, ActorIsKeyedToTheEdge) {
  room_.PaintColor(kActor, 20, 30, 160);
  room_.PaintDepth(kActor, 2.0f);
  Run(room_.Depth());
  EXPECT_GT(Share(kActor, kLabelActor), 0.99);
  EXPECT_LT(cv::countNonZero(label_), 1.02 * kActor.area());
  EXPECT_EQ(alpha_(180, 220), 255);
}

TEST_F(KeyTest, ColorAloneKeysAColoredActor) {
  room_.PaintColor(kActor, 20, 30, 160);
  Run({});
  EXPECT_GT(Share(kActor, kLabelActor), 0.98);
}

TEST_F(KeyTest, DepthAloneKeysAnActorDressedLikeTheRoom) {
  room_.PaintDepth(kActor, 2.0f);
  Run(room_.Depth());
  // His outline is lost against an equal wall; his inside is not.
  EXPECT_GT(Share({kActor.x + 24, kActor.y + 24, kActor.width - 48, kActor.height - 48}, kLabelActor), 0.99);
}

TEST_F(KeyTest, HoleInDepthIsNeverAnActor) {
  room_.PaintDepth(kActor, 0.0f);
  Run(room_.Depth());
  EXPECT_EQ(cv::countNonZero(alpha_), 0);
}

TEST_F(KeyTest, ShadowIsLabelledAndCountsAsBackground) {
  room_.Darken(kActor, 0.75f);
  Run(room_.Depth());
  EXPECT_GT(Share({kActor.x + 8, kActor.y + 8, kActor.width - 16, kActor.height - 16}, kLabelShadow), 0.95);
  EXPECT_EQ(cv::countNonZero(alpha_), 0);
}

TEST_F(KeyTest, AReflectionIsTheRoomByItsTexture) {
  const cv::Rect half(kActor.x / 2, kActor.y / 2, kActor.width / 2, kActor.height / 2);
  cv::Mat r = room_.picture.r(half), g = room_.picture.g(half), b = room_.picture.b(half);
  r.convertTo(r, -1, 0.9, -10);
  g.convertTo(g, -1, 0.8, 25);
  b.convertTo(b, -1, 0.8, -30);  // of something yellow
  Run(room_.Depth());
  EXPECT_LT(Share(kActor, kLabelActor), 0.02);
}

TEST_F(KeyTest, AMirrorImageWithEdgesOfItsOwnIsTheRoomWhereDepthSeesIt) {
  for (int y = kActor.y / 2; y < kActor.br().y / 2; ++y) {
    for (int x = kActor.x / 2; x < kActor.br().x / 2; ++x) {
      const double share = 0.35, light = 30 + 120 * ((x / 6 + y / 11) % 2);  // stripes of something yellow
      const auto mix = [&](cv::Mat1b& plane, double mirrored) {
        plane(y, x) = cv::saturate_cast<std::uint8_t>((1 - share) * plane(y, x) + share * mirrored);
      };
      mix(room_.picture.r, light);
      mix(room_.picture.g, light);
      mix(room_.picture.b, 0);
    }
  }
  Run(room_.Depth());
  EXPECT_LT(Share(kActor, kLabelActor), 0.02);
}

TEST_F(KeyTest, WhatLiesFlatOnTheRoomIsKeyedByAClearColor) {
  room_.PaintColor(kActor, 20, 30, 160);
  Run(room_.Depth());
  EXPECT_GT(Share(kActor, kLabelActor), 0.98);
}

TEST_F(KeyTest, DepthInFrontIsNoShadowHoweverMuchItLooksLikeOne) {
  room_.Darken(kActor, 0.75f);
  room_.PaintDepth(kActor, 2.0f);
  Run(room_.Depth());
  EXPECT_GT(Share({kActor.x + 24, kActor.y + 24, kActor.width - 48, kActor.height - 48}, kLabelActor), 0.99);
}

TEST_F(KeyTest, AutoExposureDoesNotKeyTheRoom) {
  for (const float gain : {0.8f, 0.9f, 1.15f, 1.3f}) {
    room_.Shoot(gain);
    Run(room_.Depth());
    EXPECT_EQ(cv::countNonZero(alpha_), 0) << gain;
  }
}

TEST_F(KeyTest, ALightSwitchedFromOnePictureToTheNextKeysHimAlone) {
  for (const float gain : {1.0f, 0.5f, 1.7f, 0.4f}) {
    room_.Shoot(gain);
    room_.PaintColor(kActor, 10, 15, 160);
    room_.PaintDepth(kActor, 2.0f);
    Run(room_.Depth());
    EXPECT_GT(Share(kActor, kLabelActor), 0.98) << gain;
    EXPECT_LT(cv::countNonZero(alpha_ >= 128), 1.04 * kActor.area()) << gain;
  }
}

TEST_F(KeyTest, WithASaturatedOrDarkPictureDepthKeysHim) {
  for (const int level : {255, 3}) {
    room_.Shoot();
    room_.PaintColor({0, 0, 512, 384}, level, level, level);
    Run(room_.Depth());
    EXPECT_LT(cv::countNonZero(alpha_ >= 128), 20) << level;
    room_.PaintDepth(kActor, 2.0f);
    Run(room_.Depth());
    const cv::Rect inside(kActor.x + 24, kActor.y + 24, kActor.width - 48, kActor.height - 48);
    EXPECT_GT(Share(inside, kLabelActor), 0.98) << level;
  }
}

TEST_F(KeyTest, AViewThatIsCoveredIsInFrontByDepth) {
  room_.PaintColor({0, 0, 512, 384}, 60, 40, 30);
  room_.PaintDepth({0, 0, 512, 384}, 0.5f);
  Run(room_.Depth());
  EXPECT_GT(Share({0, 0, 512, 384}, kLabelActor), 0.98);
  room_.Shoot();
  Run(room_.Depth());
  EXPECT_LT(cv::countNonZero(alpha_ >= 128), 20) << "and the room is the room again";
}

TEST_F(KeyTest, ActorWhoStandsStillIsNotAbsorbed) {
  for (int frame = 0; frame < 100; ++frame) {
    room_.Shoot();
    room_.PaintColor(kActor, 20, 30, 160);
    room_.PaintDepth(kActor, 2.0f);
    Run(room_.Depth());
  }
  EXPECT_GT(Share(kActor, kLabelActor), 0.99);
}

TEST_F(KeyTest, SpecksAreDroppedAndHolesFilled) {
  room_.PaintColor(kActor, 20, 30, 160);
  room_.PaintDepth(kActor, 2.0f);
  room_.PaintColor({20, 20, 4, 4}, 20, 30, 160);
  FlatRoom empty(512, 384, 3.0f);
  empty.Shoot();
  const cv::Rect hole(100, 70, 6, 6);  // half size: the room's colours amid him
  empty.picture.r(hole).copyTo(room_.picture.r(hole));
  empty.picture.g(hole).copyTo(room_.picture.g(hole));
  empty.picture.b(hole).copyTo(room_.picture.b(hole));
  Run(room_.Depth());
  EXPECT_EQ(Share({16, 16, 12, 12}, kLabelActor), 0);
  EXPECT_GT(Share(kActor, kLabelActor), 0.99);
}

TEST_F(KeyTest, AnActorWhoEntersIsSeenAtTheFirstStrip) {
  room_.PaintColor({508, 200, 4, 16}, 20, 30, 160);
  Run({});
  EXPECT_GT(Share({508, 202, 4, 12}, kLabelActor), 0.9);
  EXPECT_LT(cv::countNonZero(label_), 100);
}

TEST(Key, TakesOddAndSmallSizesAndIsDeterministic) {
  for (const cv::Size size : {cv::Size(16, 16), cv::Size(101, 77), cv::Size(323, 241), cv::Size(258, 130)}) {
    FlatRoom room(size.width, size.height, 3.0f);
    const BackgroundModel model = room.Learn(3);
    room.Shoot();
    Key key = Key::Create({}).value();
    cv::Mat1b label(size), alpha(size), again(size);
    key.Run(model, room.Luma(), room.picture, room.Depth(), 0.04f, View(label), View(alpha));
    Key second = Key::Create({}).value();
    second.Run(model, room.Luma(), room.picture, room.Depth(), 0.04f, View(label), View(again));
    EXPECT_EQ(cv::norm(alpha, again, cv::NORM_INF), 0);
    EXPECT_EQ(cv::countNonZero(alpha), 0);
  }
}

TEST(Key, RefusesBadConfiguration) {
  EXPECT_FALSE(Key::Create({.actor_prior = NAN}).has_value());
  EXPECT_FALSE(Key::Create({.own_weight = -1}).has_value());
  EXPECT_FALSE(Key::Create({.depth = {.least = 1.0f}}).has_value());
}

}  // namespace
}  // namespace mixstage
