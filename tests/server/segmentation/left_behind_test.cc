// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/left_behind.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "server/segmentation/key.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

using testing::HasSubstr;

constexpr int kWidth = 512, kHeight = 384;
const cv::Rect kBox(280, 200, 80, 100);
const cv::Rect kActor(160, 60, 140, 280);  // reaches in front of the box, 1 m nearer than it

// A box that was set down before a wall 3 m away, and an actor who walks to and fro.
class LeftBehindTest : public testing::Test {
 protected:
  LeftBehindTest() : room_(kWidth, kHeight, 3.0f), empty_(room_.Learn(12)), key_(Key::Create({}).value()) {}

  void Shoot(bool box, const cv::Rect& actor = {}) {
    room_.Shoot();
    if (box) {
      room_.PaintColor(kBox, 40, 110, 60);
      room_.PaintDepth(kBox, 2.4f);
    }
    if (!actor.empty()) {
      room_.PaintColor(actor, 20, 30, 160);
      room_.PaintDepth(actor, 1.6f);
    }
  }
  void Run(const BackgroundModel& model) {
    label_.create(kHeight, kWidth);
    alpha_.create(kHeight, kWidth);
    key_.Run(model, room_.Luma(), room_.picture, room_.Depth(), 0, View(label_), View(alpha_));
  }
  SeenFrame Seen() {
    return {.T_world_color = RigidTransform::Identity(),
            .picture = &room_.picture,
            .tone = key_.tone(),
            .half_mask = &key_.half_mask(),
            .new_depth_m = room_.Depth()};
  }
  // Looks at a point while the actor walks past the box.
  Result<std::shared_ptr<const AdoptedThing>> Adopt(double u, double v, bool walking = true) {
    left_behind_.Look(u, v);
    for (int i = 0; i < LeftBehind::kFrames; ++i) {
      Shoot(true, walking ? cv::Rect(20 + 4 * i, 60, 100, 280) : cv::Rect());
      Run(empty_);
      if (auto thing = left_behind_.See(Seen(), empty_)) {
        EXPECT_EQ(i, LeftBehind::kFrames - 1);
        return *thing;
      }
    }
    return Fail(ErrorCode::kBadInput, "no answer");
  }
  [[nodiscard]] double ShareOfActor(cv::Rect where) const {
    return cv::countNonZero(alpha_(where) >= 128) / static_cast<double>(where.area());
  }

  FlatRoom room_;
  BackgroundModel empty_;
  Key key_;
  LeftBehind left_behind_;
  cv::Mat1b label_, alpha_;
};

TEST_F(LeftBehindTest, ABoxThatWasSetDownBecomesTheRoom) {
  const auto thing = Adopt(320, 250);
  ASSERT_TRUE(thing) << thing.error().message;
  BackgroundModel model = empty_;
  LayThing(**thing, &model);

  Shoot(true);
  Run(empty_);
  EXPECT_GT(ShareOfActor(kBox), 0.97) << "without the command it stays foreground";
  Run(model);
  EXPECT_EQ(cv::countNonZero(alpha_ >= 128), 0);
  EXPECT_NEAR(model.room_depth_m(250 / 4, 320 / 4), 2.4, 0.02);
  EXPECT_NEAR(model.room_depth_m(250 / 4, 240 / 4), 3.0, 0.05);
  // The model that it was laid into is another.
  EXPECT_NEAR(empty_.room_depth_m(250 / 4, 320 / 4), 3.0, 0.05);
}

TEST_F(LeftBehindTest, AnActorBeforeItIsWhole) {
  const auto thing = Adopt(320, 250);
  ASSERT_TRUE(thing) << thing.error().message;
  BackgroundModel model = empty_;
  LayThing(**thing, &model);
  Shoot(true, kActor);
  Run(model);
  EXPECT_GT(ShareOfActor(kActor), 0.98);
  EXPECT_LT(cv::countNonZero(alpha_ >= 128), 1.03 * kActor.area());
}

TEST_F(LeftBehindTest, WhatMovesOrIsTheRoomIsRefused) {
  auto thing = Adopt(150, 200);
  ASSERT_FALSE(thing);
  EXPECT_THAT(thing.error().message, HasSubstr("stands still"));
  thing = Adopt(450, 60);
  ASSERT_FALSE(thing);
  EXPECT_THAT(thing.error().message, HasSubstr("foreground"));
  thing = Adopt(-5e9, 1e300, false);
  EXPECT_FALSE(thing);
}

TEST_F(LeftBehindTest, ACameraThatMovesMeanwhileIsSaid) {
  left_behind_.Look(320, 250);
  Shoot(true);
  Run(empty_);
  EXPECT_FALSE(left_behind_.See(Seen(), empty_));
  SeenFrame moved = Seen();
  moved.T_world_color.translation().x() = 0.1;
  const auto answer = left_behind_.See(moved, empty_);
  ASSERT_TRUE(answer && !*answer);
  EXPECT_THAT(answer->error().message, HasSubstr("camera moved"));
  EXPECT_FALSE(left_behind_.See(Seen(), empty_)) << "it looks no more";
}

// The box as the head sees it after it has turned by 5 degrees and its camera moved by a decimetre.
TEST_F(LeftBehindTest, ItStaysWhereItIsWhileTheCameraTurns) {
  const auto thing = Adopt(320, 250);
  ASSERT_TRUE(thing) << thing.error().message;
  const PinholeCamera camera{
      .width = kWidth, .height = kHeight, .fx = 450, .fy = 450, .cx = 255.5, .cy = 191.5};
  RigidTransform T_world_color = RigidTransform::Identity();
  T_world_color.linear() = Eigen::AngleAxisd(5 * M_PI / 180, Eigen::Vector3d::UnitY()).toRotationMatrix();
  T_world_color.translation() = Eigen::Vector3d(0.1, 0, 0.02);
  RoomPrediction room;
  room.width = kWidth;
  room.height = kHeight;
  for (cv::Mat1b* plane : {&room.r, &room.g, &room.b, &room.seen})
    *plane = cv::Mat1b(kHeight / 2, kWidth / 2, std::uint8_t{200});
  room.depth_m = cv::Mat1f(kHeight, kWidth, 3.0f);
  LayThing(**thing, camera, UnprojectionTable(camera), T_world_color, &room);
  int right = 0, wrong = 0;
  for (int y = 0; y < kHeight; y += 2) {
    for (int x = 0; x < kWidth; x += 2) {
      // Where the ray of this pixel meets the box's plane.
      const auto ray = *camera.Unproject(Eigen::Vector2d(x, y));
      const Eigen::Vector3d direction = T_world_color.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1);
      const double t = (2.4 - T_world_color.translation().z()) / direction.z();
      const auto then = *camera.Project(T_world_color.translation() + t * direction);
      const double beside =
          std::max({kBox.x - then.x(), then.x() - kBox.br().x, kBox.y - then.y(), then.y() - kBox.br().y});
      if (std::abs(beside) < 8) continue;  // its rim
      const bool laid = room.r(y / 2, x / 2) != 200;
      wrong += laid != (beside < 0);
      if (beside < 0) {
        right += std::abs(room.depth_m(y, x) - t) < 0.02;
        EXPECT_NEAR(room.g(y / 2, x / 2), 110, 8);
      }
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(right, 32 * 42 * 0.95);
}

}  // namespace
}  // namespace mixstage
