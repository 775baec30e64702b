// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/head/synthetic_head.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mixstage {
namespace {

constexpr std::int64_t kStartUs = 5'000'000;

TEST(SyntheticHead, ArrivesSoftlyAndNeverTurnsFasterThanItCan) {
  SyntheticHead head;
  ASSERT_TRUE(head.MoveToAt(kStartUs, 90, -20));
  const std::int64_t settles_us = head.settles_us();
  EXPECT_NEAR(static_cast<double>(settles_us - kStartUs) * 1e-6, 1.5 * 90 / 60 + 0.15, 0.01);
  double last_pan_deg = 0;
  for (std::int64_t t_us = kStartUs; t_us <= settles_us; t_us += 1'000) {
    const HeadReading at = head.At(t_us);
    EXPECT_LE(std::abs(at.pan_deg - last_pan_deg), 60 * 1e-3 + 1e-9);
    EXPECT_GE(at.pan_deg, last_pan_deg) << "no swinging";
    EXPECT_NEAR(at.tilt_deg, -20.0 / 90 * at.pan_deg, 1e-9) << "both axes go together";
    EXPECT_EQ(at.settled, t_us >= settles_us);
    last_pan_deg = at.pan_deg;
  }
  EXPECT_EQ(head.At(settles_us).pan_deg, 90);
  EXPECT_EQ(head.At(settles_us + 60'000'000).tilt_deg, -20);
}

TEST(SyntheticHead, AnotherGoalOnTheWayGoesOnFromThere) {
  SyntheticHead head;
  ASSERT_TRUE(head.MoveToAt(kStartUs, 60, 0));
  const double on_the_way_deg = head.At(kStartUs + 700'000).pan_deg;
  EXPECT_GT(on_the_way_deg, 10);
  EXPECT_LT(on_the_way_deg, 50);
  ASSERT_TRUE(head.MoveToAt(kStartUs + 700'000, -10, 5));
  EXPECT_NEAR(head.At(kStartUs + 700'000).pan_deg, on_the_way_deg, 1e-9);
  EXPECT_EQ(head.At(head.settles_us()).pan_deg, -10);
}

TEST(SyntheticHead, StaysWhereItIsWhenSentBeyondItsLimits) {
  SyntheticHead head;
  ASSERT_TRUE(head.MoveToAt(kStartUs, 12, 3));
  const HeadLimits limits = head.limits();
  for (const auto& [pan_deg, tilt_deg] :
       {std::pair<double, double>(limits.pan_max_deg + 0.1, 0),
        std::pair<double, double>(limits.pan_min_deg - 1e300, 0),
        std::pair<double, double>(0, limits.tilt_min_deg - 0.1), std::pair<double, double>(std::nan(""), 0),
        std::pair<double, double>(0, INFINITY)}) {
    const Status moved = head.MoveToAt(kStartUs + 9'000'000, pan_deg, tilt_deg);
    ASSERT_FALSE(moved);
    EXPECT_EQ(moved.error().code, ErrorCode::kBadInput);
    EXPECT_NE(moved.error().message.find("limits"), std::string::npos);
  }
  EXPECT_EQ(head.At(kStartUs + 9'000'000).pan_deg, 12);
  EXPECT_TRUE(head.MoveToAt(kStartUs + 9'000'000, limits.pan_max_deg, limits.tilt_min_deg));
}

TEST(SyntheticHead, ItsEncodersAreAHundredthOfADegreeOff) {
  SyntheticHead head;
  double sum = 0, sum2 = 0;
  constexpr int kReadings = 2'000;
  for (int i = 0; i < kReadings; ++i) {
    const double pan_deg = head.Read().value().pan_deg;
    sum += pan_deg;
    sum2 += pan_deg * pan_deg;
  }
  EXPECT_NEAR(sum / kReadings, 0, 0.001);
  EXPECT_NEAR(std::sqrt(sum2 / kReadings), 0.01, 0.001);
}

}  // namespace
}  // namespace mixstage
