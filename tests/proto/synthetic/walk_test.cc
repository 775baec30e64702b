// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/walk.h"

#include <gtest/gtest.h>

#include <cmath>

#include "proto/synthetic/figure.h"
#include "proto/synthetic/room_plan.h"

namespace mixstage {
namespace {

constexpr double kTick_s = 1.0 / 60;

TEST(Walk, SetIsEmptyAtBothEndsOfTheLoopAndTheLoopRepeats) {
  for (const double t : {0.0, 1.5, 2.99, 22.0, 23.9}) EXPECT_FALSE(Walk::Present(t)) << t;
  for (const double t : {3.0, 10.0, 21.9}) EXPECT_TRUE(Walk::Present(t)) << t;
  EXPECT_TRUE(Walk::Present(10.0 + 5 * kLoop_s));
  EXPECT_FALSE(Walk::Present(-1.0));
  const Walk walk;
  const WalkState a = walk.At(13.37);
  const WalkState b = walk.At(13.37 + 3 * kLoop_s);
  EXPECT_LT((a.body - b.body).norm(), 1e-9);
  EXPECT_NEAR(a.wave_angle, b.wave_angle, 1e-9);
}

TEST(Walk, NothingJumps) {
  const Walk walk;
  WalkState last = walk.At(kEnter_s);
  for (double t = kEnter_s + kTick_s; t < kLeave_s; t += kTick_s) {
    const WalkState now = walk.At(t);
    EXPECT_LT((now.body - last.body).norm(), 1.5 * kTick_s) << t;                                 // 1.5 m/s
    EXPECT_LT(std::abs(std::remainder(now.yaw_rad - last.yaw_rad, 6.2832)), 4.0 * kTick_s) << t;  // 4 rad/s
    for (const int foot : {0, 1}) {
      EXPECT_LT((now.foot[foot].ankle_rest - last.foot[foot].ankle_rest).norm(), 5.5 * kTick_s) << t;
    }
    last = now;
  }
}

TEST(Walk, APlantedFootStaysWhereItIsAndOneFootIsAlwaysPlanted) {
  const Walk walk;
  WalkState last = walk.At(kEnter_s);
  for (double t = kEnter_s + kTick_s; t < kLeave_s; t += kTick_s) {
    const WalkState now = walk.At(t);
    EXPECT_TRUE(now.foot[0].swing == 0 || now.foot[1].swing == 0) << t;
    for (const int foot : {0, 1}) {
      if (now.foot[foot].swing > 0 || last.foot[foot].swing > 0) continue;
      EXPECT_LT((now.foot[foot].ankle_rest - last.foot[foot].ankle_rest).norm(), 1e-9) << t;
    }
    last = now;
  }
}

TEST(Walk, PassesBehindTheNearSpotAndInFrontOfTheFarOneFreeOfBoth) {
  const Walk walk;
  bool crossed_near = false;
  bool crossed_far = false;
  for (double t = kEnter_s; t < kLeave_s; t += kTick_s) {
    const Eigen::Vector2d body = walk.At(t).body;
    // Along the line of sight from the head, about the origin.
    auto ahead = [&](const Eigen::Vector3d& spot) {
      const Eigen::Vector2d s = spot.head<2>();
      const double sideways = (body.x() * s.y() - body.y() * s.x()) / s.norm();
      return std::abs(sideways) < 0.05 ? body.norm() - s.norm() : 0.0;
    };
    const double near = ahead(room_plan::kNearSpot);
    const double far = ahead(room_plan::kFarSpot);
    EXPECT_GE(near, 0) << t;
    EXPECT_LE(far, 0) << t;
    crossed_near |= near > 0;
    crossed_far |= far < 0;
    EXPECT_GT((body - room_plan::kNearSpot.head<2>()).norm(), 0.55) << t;
    EXPECT_GT((body - room_plan::kFarSpot.head<2>()).norm(), 0.55) << t;
  }
  EXPECT_TRUE(crossed_near);
  EXPECT_TRUE(crossed_far);
}

TEST(Figure, LimbsMoveAndNothingSinksIntoTheFloor) {
  const Walk walk;
  Figure a;
  Figure b;
  PoseFigure(walk.At(6.0), a);
  PoseFigure(walk.At(6.3), b);
  ASSERT_EQ(a.count, b.count);
  EXPECT_GT(a.count, 12);
  double least = 1e9;
  double most = 0;
  for (int i = 0; i < a.count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    const double moved = (a.parts[k].cone.a - b.parts[k].cone.a).norm();
    least = std::min(least, moved);
    most = std::max(most, moved);
  }
  EXPECT_GT(most - least, 0.3);  // m: a swinging foot against a planted one
  for (double t = kEnter_s; t < kLeave_s; t += 0.05) {
    PoseFigure(walk.At(t), a);
    double lowest = 1e9;
    double highest = 0;
    for (int i = 0; i < a.count; ++i) {
      const Eigen::AlignedBox3d box = a.parts[static_cast<std::size_t>(i)].cone.Bounds();
      lowest = std::min(lowest, box.min().z());
      highest = std::max(highest, box.max().z());
    }
    EXPECT_GT(lowest, -0.02) << t;  // m: a sole's rounded edge when the foot rolls
    EXPECT_LT(lowest, 0.02) << t;
    EXPECT_GT(highest, 1.70) << t;
    EXPECT_LT(highest, 2.15) << t;  // a waving hand
  }
}

TEST(Figure, BonesKeepTheirLengths) {
  const Walk walk;
  Figure figure;
  PoseFigure(walk.At(5.0), figure);
  std::array<double, Figure::kMaxParts> lengths{};
  for (int i = 0; i < figure.count; ++i) {
    const auto k = static_cast<std::size_t>(i);
    lengths[k] = figure.parts[k].cone.length_m;
  }
  for (double t = kEnter_s; t < kLeave_s; t += 0.1) {
    PoseFigure(walk.At(t), figure);
    for (int i = 0; i < figure.count; ++i) {
      const auto k = static_cast<std::size_t>(i);
      // Cloth stretches by millimetres where the chest turns against the hips.
      EXPECT_NEAR(figure.parts[k].cone.length_m, lengths[k], 0.02) << "part " << i << " at " << t;
    }
  }
}

}  // namespace
}  // namespace mixstage
