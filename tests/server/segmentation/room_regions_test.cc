// SPDX-License-Identifier: Apache-2.0
//
// A wall 3 m away, a region in front of it or on it, and where its corners project to.
#include "server/segmentation/room_regions.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "server/segmentation/key.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

constexpr int kWidth = 512, kHeight = 384;
const PinholeCamera kCamera{.width = kWidth, .height = kHeight, .fx = 400, .fy = 400, .cx = 256, .cy = 192};
const cv::Rect kActor(160, 80, 120, 200);

RoomRegion Box(RegionKind kind, const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  RoomRegion region{"box", kind, {}};
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d inward = Eigen::Vector3d::Unit(axis);
    region.planes.emplace_back(inward.x(), inward.y(), inward.z(), -low[axis]);
    region.planes.emplace_back(-inward.x(), -inward.y(), -inward.z(), high[axis]);
  }
  return region;
}

// What the wall shows of a box: full pixels.
cv::Rect OnTheWall(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  const auto at = [](const Eigen::Vector3d& p) {
    const Eigen::Vector2d pixel = *kCamera.Project({p.x(), p.y(), 3.0});
    return cv::Point(static_cast<int>(std::lround(pixel.x())), static_cast<int>(std::lround(pixel.y())));
  };
  return {at(low), at(high)};
}

cv::Rect Grown(const cv::Rect& r, int by) {
  return {r.x - by, r.y - by, r.width + 2 * by, r.height + 2 * by};
}

class RoomRegionsTest : public ::testing::Test {
 protected:
  RoomRegionsTest() : room_(kWidth, kHeight, 3.0f), model_(room_.Learn(12)), key_(Key::Create({}).value()) {
    room_.Shoot();
  }
  void PaintActor(float z_m) {
    room_.PaintColor(kActor, 20, 30, 160);
    room_.PaintDepth(kActor, z_m);
  }
  void Run(RegionMask* regions, const RigidTransform& T_world_color, ImageView<const float> depth) {
    label_.create(kHeight, kWidth);
    alpha_.create(kHeight, kWidth);
    regions->Run(T_world_color, model_, depth);
    key_.Run(model_, room_.Luma(), room_.picture, depth, 0, View(label_), View(alpha_), regions);
  }
  void Run(RoomRegion region, ImageView<const float> depth) {
    RegionMask mask(kCamera, {RegionFrame::kCamera, {std::move(region)}});
    Run(&mask, RigidTransform::Identity(), depth);
  }
  [[nodiscard]] double Share(const cv::Rect& where) const {
    return cv::countNonZero(alpha_(where) >= 128) / static_cast<double>(where.area());
  }
  FlatRoom room_;
  BackgroundModel model_;
  Key key_;
  cv::Mat1b label_, alpha_;
};

TEST_F(RoomRegionsTest, NobodyIsAnActorInGarbage) {
  PaintActor(2.6f);
  Run({"back", RegionKind::kGarbage, {{0, 0, 1, -2.3}}}, room_.Depth());
  EXPECT_EQ(cv::countNonZero(alpha_), 0);
  EXPECT_EQ(cv::countNonZero(label_ == kLabelActor), 0);
}

TEST_F(RoomRegionsTest, AnActorInFrontOfGarbageIsWhole) {
  PaintActor(2.0f);
  Run({"back", RegionKind::kGarbage, {{0, 0, 1, -2.3}}}, room_.Depth());
  EXPECT_GT(Share(kActor), 0.99);
  EXPECT_LT(cv::countNonZero(alpha_ >= 128), 1.02 * kActor.area());
}

TEST_F(RoomRegionsTest, WhatShinesOnTheWallIsNobodyAndWhoStandsBesideItIs) {
  PaintActor(2.0f);
  const Eigen::Vector3d low(0.6, -0.6, 2.9), high(1.4, 0.4, 3.1);
  const cv::Rect screen = OnTheWall(low, high);
  room_.PaintColor(screen, 200, 20, 30);
  Run(Box(RegionKind::kGarbage, low, high), room_.Depth());
  EXPECT_EQ(cv::countNonZero(alpha_(Grown(screen, -8))), 0);
  EXPECT_GT(Share(kActor), 0.99);
}

TEST_F(RoomRegionsTest, ByColorAloneTheLineOfSightCounts) {
  model_ = BackgroundModel();
  auto estimator = BackgroundEstimator::Create({}, kWidth, kHeight).value();
  for (int i = 0; i < 12; ++i) {
    room_.Shoot();
    estimator.Add(room_.picture, {});
  }
  model_ = estimator.EstimateEmpty().value();
  room_.Shoot();
  room_.PaintColor(kActor, 20, 30, 160);
  const Eigen::Vector3d low(-3, -3, 2.9), high(3, 0, 3.1);  // all above the middle of the picture
  Run(Box(RegionKind::kGarbage, low, high), {});
  const cv::Rect above(kActor.x, kActor.y, kActor.width, 96), below(kActor.x, 208, kActor.width, 60);
  EXPECT_EQ(Share(above), 0);
  EXPECT_GT(Share(below), 0.98);
}

TEST_F(RoomRegionsTest, TheRoomInAHoldOutIsForegroundWithTheRoomsDepth) {
  const Eigen::Vector3d low(-0.8, -0.5, 2.9), high(0.4, 0.7, 3.1);
  RegionMask mask(kCamera, {RegionFrame::kCamera, {Box(RegionKind::kHoldOut, low, high)}});
  Run(&mask, RigidTransform::Identity(), room_.Depth());
  const cv::Rect truth = OnTheWall(low, high);
  EXPECT_EQ(cv::countNonZero(alpha_(Grown(truth, -4)) == 255), Grown(truth, -4).area());
  EXPECT_EQ(cv::countNonZero(alpha_), cv::countNonZero(alpha_(Grown(truth, 4))));
  EXPECT_EQ(cv::countNonZero(key_.half_mask()), 0);  // it is no actor's body
  cv::Mat1f surface(Half(kHeight), Half(kWidth), 0.0f);
  mask.LayDepth(model_, &surface);
  EXPECT_NEAR(surface(192 / 2, 200 / 2), 3.0f, 0.02f);
  EXPECT_EQ(surface(20, 20), 0.0f);
}

TEST_F(RoomRegionsTest, AThingInAHoldOutIsForegroundThoughItLooksLikeTheRoom) {
  room_.PaintDepth(kActor, 2.0f);
  Run(Box(RegionKind::kHoldOut, {-3, -3, 1.5}, {3, 3, 2.5}), room_.Depth());
  EXPECT_GT(Share(Grown(kActor, -6)), 0.99);
  EXPECT_EQ(Share({320, 80, 120, 200}), 0);
}

TEST_F(RoomRegionsTest, HoldOutWins) {
  const Eigen::Vector3d low(-0.8, -0.5, 2.9), high(0.4, 0.7, 3.1);
  RegionMask mask(kCamera,
                  {RegionFrame::kCamera,
                   {Box(RegionKind::kHoldOut, low, high), {"back", RegionKind::kGarbage, {{0, 0, 1, -2}}}}});
  Run(&mask, RigidTransform::Identity(), room_.Depth());
  EXPECT_EQ(Share(Grown(OnTheWall(low, high), -4)), 1);
}

TEST_F(RoomRegionsTest, ARegionStaysWhereItIsWhileTheCameraTurns) {
  // The world's frame is the camera's of before; then it turns by 10 degrees to the right.
  const Eigen::Vector3d low(-0.2, -0.5, 2), high(0.2, 0.5, 4);
  RegionMask mask(kCamera, {RegionFrame::kWorld, {Box(RegionKind::kHoldOut, low, high)}});
  Run(&mask, RigidTransform::Identity(), {});
  const double before = cv::moments(alpha_, true).m10 / cv::moments(alpha_, true).m00;
  EXPECT_NEAR(before, 256, 3);
  const double turn_rad = 10 * CV_PI / 180;
  const RigidTransform turned(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitY()));
  Run(&mask, turned, {});
  const double after = cv::moments(alpha_, true).m10 / cv::moments(alpha_, true).m00;
  EXPECT_NEAR(after, 256 - 400 * std::tan(turn_rad), 5);
}

}  // namespace
}  // namespace mixstage
