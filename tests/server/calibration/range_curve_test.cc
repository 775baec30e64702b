// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/range_curve.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/support/board_picture.h"

namespace mixstage {
namespace {

constexpr double kWrap_m = 7.5;

double TrueError(double r) {
  return 0.004 + 0.009 * std::sin(8 * std::numbers::pi * r / kWrap_m + 0.4) +
         0.006 * std::sin(2 * std::numbers::pi * r / kWrap_m + 2.0);
}

// Boards between 1 and 3 m, dark and bright squares, noise by amplitude, one in fifty pixels wild.
template <typename Error>
std::vector<RangeSample> Samples(Error error, double dark_m) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal(0, 1);
  std::vector<RangeSample> samples;
  for (std::size_t view = 0; view < 24; ++view) {
    const double middle = 1.1 + 1.8 * static_cast<double>(view) / 23;
    for (int i = 0; i < 1500; ++i) {
      RangeSample s;
      s.view = view;
      s.range_m = middle + 0.15 * (i % 100 - 50) / 50;
      const bool dark = i % 2 == 0;
      s.amplitude = (dark ? 250 : 2500) / (s.range_m * s.range_m);
      s.measured_m =
          s.range_m + error(s.range_m) + (dark ? dark_m : 0) + normal(random) * (dark ? 0.03 : 0.008);
      if (i % 50 == 7) s.measured_m += 0.8;
      samples.push_back(s);
    }
  }
  return samples;
}

TEST(RangeCurve, FindsTheErrorWithinTheBoardsDistancesAndBeyondByHarmonics) {
  const auto curve = FitRangeCurve(Samples(TrueError, 0), kWrap_m);
  ASSERT_TRUE(curve) << curve.error().message;
  EXPECT_TRUE(curve->harmonics);
  for (double r = 1.1; r < 2.9; r += 0.1) EXPECT_NEAR(curve->error.At(r), TrueError(r), 0.0015) << r;
  for (double r = 3; r < 5; r += 0.5) {
    const auto i = static_cast<std::size_t>((r - curve->error.range_m.front()) / 0.05);
    EXPECT_NEAR(curve->error.At(r), TrueError(r), std::max(0.002, 4 * curve->error.std_m[i])) << r;
  }
  EXPECT_LT(curve->held_out_rms_m, 0.002);
  EXPECT_LT(std::abs(curve->dark_minus_bright_m), 5 * curve->dark_minus_bright_std_m);
}

TEST(RangeCurve, WhatNoHarmonicsExplainIsConstantBeyondTheBoards) {
  auto bend = [](double r) { return 0.02 * std::sin(2 * std::numbers::pi * r / 1.2); };
  const auto curve = FitRangeCurve(Samples(bend, 0), kWrap_m);
  ASSERT_TRUE(curve);
  EXPECT_FALSE(curve->harmonics);
  EXPECT_EQ(curve->error.At(0.2), curve->error.error_m.front());
  EXPECT_EQ(curve->error.At(6.0), curve->error.error_m.back());
  for (double r = 1.2; r < 2.8; r += 0.1) EXPECT_NEAR(curve->error.At(r), bend(r), 0.004) << r;
}

TEST(RangeCurve, ABiasOfDarkSquaresIsTold) {
  const auto curve = FitRangeCurve(Samples(TrueError, 0.006), kWrap_m);
  ASSERT_TRUE(curve);
  EXPECT_NEAR(curve->dark_minus_bright_m, 0.006, 0.0015);
}

TEST(RangeCurve, OneDistanceIsNotEnough) {
  auto samples = Samples(TrueError, 0);
  std::erase_if(samples, [](const RangeSample& s) { return s.view != 5; });
  const auto curve = FitRangeCurve(samples, kWrap_m);
  ASSERT_FALSE(curve);
  EXPECT_EQ(curve.error().code, ErrorCode::kQualityGate);
}

TEST(RangeSamples, LieOnTheBoardAndAreUnwrapped) {
  const Board board{"a", 9, 6, 0.07, 0.07};
  const Lens tof = LensOf(PinholeCamera{176, 144, 220, 220, 90, 69, -0.25, 0.1});
  const RigidTransform T = BoardAt(board, 2.0, 20, -15, 5);
  cv::Mat1w range(144, 176);
  for (int v = 0; v < 144; ++v) {
    for (int u = 0; u < 176; ++u) {
      const Eigen::Vector3d ray = *tof.Unproject({u, v});
      const RigidTransform back = T.inverse();
      const double along = -back.translation().z() / (back.linear() * ray).z();
      range(v, u) = static_cast<std::uint16_t>(std::fmod(along, 1.8) / 0.00025);  // wraps before the board
    }
  }
  std::vector<RangeSample> samples;
  AppendRangeSamples(tof, T, board, range, {}, {0.00025, 1.8, false}, 3, samples);
  // The board is 11 x 8 squares of 7.7 px, less 2.5 px all round.
  EXPECT_NEAR(static_cast<double>(samples.size()), 11 * 8 * 7.7 * 7.7 * 0.8, 900);
  for (const RangeSample& s : samples) EXPECT_NEAR(s.measured_m, s.range_m, 0.0005);
}

}  // namespace
}  // namespace mixstage
