// SPDX-License-Identifier: Apache-2.0
#include "proto/geometry/sweep_grid.h"

#include <gtest/gtest.h>

#include <cmath>

#include "proto/synthetic/rig.h"

namespace mixstage {
namespace {

TEST(SweepGrid, ReachesTheEdgesOfTheAreaWithHalfAPictureOfOverlap) {
  const Rig rig = SyntheticRig();
  const Eigen::Vector2d field = SharedFieldOfView_deg(rig);
  EXPECT_NEAR(field.x(), 52.8, 0.1);
  EXPECT_NEAR(field.y(), 40.6, 0.1);
  const auto grid = SweepGrid(rig, {});
  ASSERT_TRUE(grid.has_value());
  EXPECT_EQ(grid->size(), 16u);
  double left = -1e9, right = 1e9, top = -1e9, bottom = 1e9;
  for (std::size_t i = 0; i < grid->size(); ++i) {
    const HeadPosition& at = (*grid)[i];
    left = std::max(left, at.pan_deg + 0.5 * field.x());
    right = std::min(right, at.pan_deg - 0.5 * field.x());
    top = std::max(top, at.tilt_deg + 0.5 * field.y());
    bottom = std::min(bottom, at.tilt_deg - 0.5 * field.y());
    if (i == 0) continue;
    const HeadPosition& before = (*grid)[i - 1];  // one step at a time, in one direction
    EXPECT_LE(std::abs(at.pan_deg - before.pan_deg), 0.5 * field.x() + 1e-9);
    EXPECT_LE(std::abs(at.tilt_deg - before.tilt_deg), 0.5 * field.y() + 1e-9);
    EXPECT_TRUE(at.pan_deg == before.pan_deg || at.tilt_deg == before.tilt_deg);
  }
  EXPECT_NEAR(left, 60, 1e-9);
  EXPECT_NEAR(right, -60, 1e-9);
  EXPECT_NEAR(top, 50, 1e-9);
  EXPECT_NEAR(bottom, -50, 1e-9);
}

TEST(SweepGrid, AWholeTurnMeetsItselfOnce) {
  const Rig rig = SyntheticRig();
  const auto grid =
      SweepGrid(rig, {.pan_from_deg = -180, .pan_to_deg = 180, .tilt_from_deg = 0, .tilt_to_deg = 0});
  ASSERT_TRUE(grid.has_value());
  ASSERT_EQ(grid->size(), 14u);
  const double step_deg = (*grid)[1].pan_deg - (*grid)[0].pan_deg;
  EXPECT_NEAR((*grid)[0].pan_deg + 360 - grid->back().pan_deg, step_deg, 1e-9);
  EXPECT_LE(step_deg, 0.5 * SharedFieldOfView_deg(rig).x());
}

TEST(SweepGrid, AnAreaSmallerThanAPictureIsOnePosition) {
  const auto grid = SweepGrid(SyntheticRig(),
                              {.pan_from_deg = 10, .pan_to_deg = 20, .tilt_from_deg = -5, .tilt_to_deg = -5});
  ASSERT_TRUE(grid.has_value());
  ASSERT_EQ(grid->size(), 1u);
  EXPECT_DOUBLE_EQ(grid->front().pan_deg, 15);
  EXPECT_DOUBLE_EQ(grid->front().tilt_deg, -5);
}

TEST(SweepGrid, WhatIsNoAreaIsRefused) {
  for (const SweepArea& area :
       {SweepArea{.pan_from_deg = 10, .pan_to_deg = -10}, SweepArea{.pan_from_deg = -200, .pan_to_deg = 200},
        SweepArea{.pan_from_deg = std::nan("")}, SweepArea{.tilt_from_deg = -91},
        SweepArea{.tilt_from_deg = 20, .tilt_to_deg = 10}, SweepArea{.tilt_to_deg = std::nan("")}}) {
    EXPECT_FALSE(SweepGrid(SyntheticRig(), area).has_value());
  }
}

}  // namespace
}  // namespace mixstage
