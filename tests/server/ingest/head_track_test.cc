// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/head_track.h"

#include <gtest/gtest.h>

#include <random>

namespace mixstage {
namespace {

TEST(HeadTrack, FollowsAMovingHeadBetweenItsReadings) {
  HeadTrack track;
  for (int i = 0; i <= 20; ++i) track.Add(i * 20'000, {0.02 * 20 * i, -0.01 * 20 * i});  // 20 and -10 deg/s
  const auto between = track.At(207'000);
  ASSERT_TRUE(between);
  EXPECT_NEAR(between->pan_deg, 4.14, 1e-9);
  EXPECT_NEAR(between->tilt_deg, -2.07, 1e-9);
  const auto ahead = track.At(413'000);  // live: nothing later is known yet
  ASSERT_TRUE(ahead);
  EXPECT_NEAR(ahead->pan_deg, 8.26, 1e-9);
}

TEST(HeadTrack, AveragesTheEncodersTremble) {
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.01);
  HeadTrack track;
  double square = 0;
  int count = 0;
  for (int i = 0; i < 2000; ++i) {
    track.Add(i * 20'000, {5 + noise(random), noise(random)});
    if (i < 10) continue;
    const double error = track.At((i - 3) * 20'000 + 5'000)->pan_deg - 5;
    square += error * error;
    ++count;
  }
  EXPECT_LT(std::sqrt(square / count), 0.006);
}

TEST(HeadTrack, TakesTheNewestWhereReadingsAreRare) {
  HeadTrack track;
  EXPECT_FALSE(track.At(0));
  track.Add(1'000'000, {1, 2});
  track.Add(3'000'000, {3, 4});
  track.Add(3'000'000, {9, 9});  // not later: left out
  EXPECT_FALSE(track.At(999'999));
  EXPECT_EQ(track.At(1'000'000)->pan_deg, 1);
  EXPECT_EQ(track.At(2'990'000)->pan_deg, 1);
  EXPECT_EQ(track.At(9'000'000)->tilt_deg, 4);
}

}  // namespace
}  // namespace mixstage
