// SPDX-License-Identifier: Apache-2.0
#include "server/composite/avatar_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "server/scene/avatar.h"

namespace mixstage {
namespace {

constexpr int kWidth = 320, kHeight = 240;

PinholeCamera Camera(double f) {
  return {.width = kWidth, .height = kHeight, .fx = f, .fy = f, .cx = 158.5, .cy = 121};
}

YuvImage Grey(std::uint8_t y) {
  YuvImage picture;
  picture.Create(kWidth, kHeight, ChromaLayout::k420);
  picture.y.setTo(y);
  picture.cb.setTo(128);
  picture.cr.setTo(128);
  return picture;
}

// Somebody flat who faces the camera: a rectangle with a pattern on it, before a dark room.
class AvatarViewTest : public testing::Test {
 protected:
  AvatarViewTest() : color_(Grey(30)), backdrop_(Grey(60)) {
    alpha_ = cv::Mat1b(kHeight, kWidth, std::uint8_t{0});
    depth_ = cv::Mat1f(kHeight / 2, kWidth / 2, 0.0f);
    room_.revision = 1;
    room_.depth_m = cv::Mat1f(kHeight, kWidth, 9.0f);
    room_.sigma_m = cv::Mat1f(kHeight, kWidth, 0.01f);
  }
  void Stand(const cv::Rect& where, float z) {
    alpha_(where).setTo(255);
    for (int y = where.y; y < where.br().y; ++y) {
      for (int x = where.x; x < where.br().x; ++x) {
        color_.y(y, x) = static_cast<std::uint8_t>(120 + 60 * std::sin(0.2 * x) * std::cos(0.15 * y));
        depth_(y / 2, x / 2) = z;
      }
    }
  }
  void Run(const PinholeCamera& color, const PinholeCamera& view, const RigidTransform& T_view_color) {
    auto drawing = AvatarView::Create(color, view);
    ASSERT_TRUE(drawing) << drawing.error().message;
    drawing->Run({.color = &color_,
                  .alpha = View(std::as_const(alpha_)),
                  .actor_depth_m = View(std::as_const(depth_)),
                  .T_view_color = T_view_color},
                 {.picture = &backdrop_, .depth = &room_}, out_);
  }
  // Largest difference from the captured picture where he covers pixels wholly, and of the matte anywhere.
  [[nodiscard]] std::pair<int, int> Differences() const {
    int luma = 0, matte = 0;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        matte = std::max(matte, std::abs(out_.alpha(y, x) - alpha_(y, x)));
        if (alpha_(y, x) == 255) luma = std::max(luma, std::abs(out_.picture.y(y, x) - color_.y(y, x)));
      }
    }
    return {luma, matte};
  }

  YuvImage color_, backdrop_;
  cv::Mat1b alpha_;
  cv::Mat1f depth_;
  RoomDepth room_;
  AvatarPicture out_;
};

TEST_F(AvatarViewTest, WhereHeIsIsWhereHeWasThroughTheSameCamera) {
  PinholeCamera lens = Camera(300);
  lens.k1 = -0.12;
  lens.k2 = 0.06;
  Stand({100, 40, 60, 150}, 3);
  Run(lens, lens, RigidTransform::Identity());
  const auto [luma, matte] = Differences();
  EXPECT_LE(luma, 1);
  EXPECT_LE(matte, 1);
  EXPECT_EQ(out_.picture.y(10, 10), 60);  // the backdrop
  EXPECT_NEAR(out_.actor_depth_m(50, 60), 3, 1e-3);
}

TEST_F(AvatarViewTest, HeGoesOnToThePicturesBorder) {
  Stand({100, 90, 60, 150}, 3);
  Run(Camera(300), Camera(300), RigidTransform::Identity());
  EXPECT_EQ(out_.alpha(kHeight - 1, 130), 255);
  EXPECT_EQ(out_.picture.y(kHeight - 1, 130), color_.y(kHeight - 1, 130));
}

// piVE eq (9): pasted as he is, an avatar taken with f_a stands at Z_ba = Z_a f_b / f_a in a picture taken
// with f_b. Put there, he is drawn as he is.
TEST_F(AvatarViewTest, AtTheDistanceOfEq9HisPictureIsUnchanged) {
  for (const double f_b : {200.0, 300.0, 470.0}) {
    SCOPED_TRACE(f_b);
    const double f_a = 300, Z_a = 3, Z_ba = Z_a * f_b / f_a;
    Stand({100, 40, 60, 150}, static_cast<float>(Z_a));
    RigidTransform T_view_color = RigidTransform::Identity();
    T_view_color.translation().z() = Z_ba - Z_a;
    Run(Camera(f_a), Camera(f_b), T_view_color);
    const auto [luma, matte] = Differences();
    EXPECT_LE(luma, 1);
    EXPECT_LE(matte, 1);
    EXPECT_NEAR(out_.actor_depth_m(50, 60), Z_ba, 1e-3);
  }
}

TEST_F(AvatarViewTest, FartherAwayHeIsSmallerInProportion) {
  Stand({100, 40, 60, 150}, 3);
  RigidTransform T_view_color = RigidTransform::Identity();
  T_view_color.translation().z() = 6;
  Run(Camera(300), Camera(300), T_view_color);
  const cv::Rect box = cv::boundingRect(out_.alpha >= 128);
  EXPECT_NEAR(box.width, 20, 1);
  EXPECT_NEAR(box.height, 50, 1);
}

// A small thing on the floor that he walks on is seen where the placed point of the floor projects to.
TEST_F(AvatarViewTest, APointOnTheFloorStaysOnTheFloor) {
  const auto T_world_color = TTargetView({.position = {0, 0, 1.4}, .look_at = {3, 0.2, 0.4}, .view_deg = {}});
  const auto T_target_view = TTargetView({.position = {5, -1, 1.8}, .look_at = {3, 2, 0.2}, .view_deg = {}});
  ASSERT_TRUE(T_world_color);
  ASSERT_TRUE(T_target_view);
  const PinholeCamera a = Camera(300), b = Camera(420);
  for (const Eigen::Vector3d& spot : {Eigen::Vector3d(3, 0, 0), Eigen::Vector3d(2.5, 0.6, 0)}) {
    const Eigen::Vector3d p_color = T_world_color->inverse() * spot;
    const auto pixel = a.Project(p_color);
    ASSERT_TRUE(pixel);
    alpha_.setTo(0);
    depth_.setTo(0);
    const cv::Point at(static_cast<int>(std::lround(pixel->x())), static_cast<int>(std::lround(pixel->y())));
    Stand({at.x - 4, at.y - 4, 9, 9}, static_cast<float>(p_color.z()));
    Avatar avatar;
    avatar.anchor = {3, 0};
    avatar.position = {3.2, 1.5, 0};
    avatar.turn_deg = 25;
    Run(a, b, T_target_view->inverse() * avatar.TTargetWorld() * *T_world_color);
    const cv::Moments m = cv::moments(out_.alpha);
    ASSERT_GT(m.m00, 0);
    const Eigen::Vector3d placed = avatar.TTargetWorld() * spot;
    EXPECT_NEAR(placed.z(), 0, 1e-12);
    const auto expected = b.Project(T_target_view->inverse() * placed);
    ASSERT_TRUE(expected);
    EXPECT_NEAR(m.m10 / m.m00, expected->x(), 1.5);
    EXPECT_NEAR(m.m01 / m.m00, expected->y(), 1.5);
  }
}

TEST_F(AvatarViewTest, WhatIsNearerHidesHim) {
  Stand({100, 40, 60, 150}, 3);
  room_.depth_m(cv::Rect(0, 0, 130, kHeight)).setTo(2.5f);
  room_.depth_m(cv::Rect(130, 0, 15, kHeight)).setTo(2.99f);  // he leans on it
  room_.depth_m(cv::Rect(145, 0, 5, kHeight)).setTo(0.0f);    // not known
  Run(Camera(300), Camera(300), RigidTransform::Identity());
  EXPECT_EQ(out_.alpha(100, 120), 0);
  EXPECT_EQ(out_.picture.y(100, 120), 60);
  EXPECT_EQ(out_.alpha(100, 140), 255);
  EXPECT_EQ(out_.alpha(100, 147), 255);
  EXPECT_EQ(out_.alpha(100, 155), 255);
  EXPECT_NEAR(out_.actor_depth_m(50, 60), 3, 1e-3);  // behind it he still is: he casts, and is touched
}

TEST_F(AvatarViewTest, WhatShoneThroughHisOutlineStaysBehind) {
  Stand({100, 40, 60, 150}, 3);
  color_.y(cv::Rect(100, 40, 60, 150)).setTo(180);
  const cv::Rect edge(96, 40, 4, 150);  // 60 % he, the rest a room of 30
  alpha_(edge).setTo(153);
  color_.y(edge).setTo(120);
  for (int y = edge.y / 2; y < edge.br().y / 2; ++y) depth_(y, 48) = depth_(y, 49) = 3;
  backdrop_ = Grey(180);
  const cv::Mat3b foreground(kHeight, kWidth, cv::Vec3b::all(180));
  auto drawing = AvatarView::Create(Camera(300), Camera(300));
  ASSERT_TRUE(drawing);
  drawing->Run({.color = &color_,
                .alpha = View(std::as_const(alpha_)),
                .foreground = &foreground,
                .actor_depth_m = View(std::as_const(depth_))},
               {.picture = &backdrop_, .depth = nullptr}, out_);
  EXPECT_NEAR(out_.picture.y(100, 97), 180, 2);  // no dark seam before a bright room
  EXPECT_NEAR(out_.foreground(100, 97)[1], 180, 2);
}

TEST_F(AvatarViewTest, WithoutAnybodyTheBackdropIsLeftAlone) {
  Run(Camera(300), Camera(300), RigidTransform::Identity());
  EXPECT_EQ(cv::countNonZero(out_.picture.y != backdrop_.y), 0);
  EXPECT_EQ(cv::countNonZero(out_.alpha), 0);
}

}  // namespace
}  // namespace mixstage
