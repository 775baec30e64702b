// SPDX-License-Identifier: Apache-2.0
#include "server/environment/range_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/box_room.h"

namespace mixstage {
namespace {

// Frames of a wall across the view at `range_m` with a sensor of noise sqrt(c0 + c1 A) / A.
RangeFrames WallFrames(const RangeCamera& camera, double range_m, double amplitude, double c0, double c1,
                       int frames, std::mt19937& random) {
  std::normal_distribution<double> normal;
  RangeFrames out;
  for (int k = 0; k < frames; ++k) {
    cv::Mat1w counts(camera.ray.size()), amplitudes(camera.ray.size());
    for (int y = 0; y < counts.rows; ++y) {
      for (int x = 0; x < counts.cols; ++x) {
        const double A = amplitude * (1 + static_cast<double>(x) / counts.cols);
        double r = range_m + normal(random) * std::sqrt(c0 + c1 * A) / A;
        if (camera.wrap_m > 0) r -= camera.wrap_m * std::floor(r / camera.wrap_m);
        counts(y, x) = static_cast<std::uint16_t>(std::lround(r / camera.unit_m));
        amplitudes(y, x) = static_cast<std::uint16_t>(std::lround(A));
      }
    }
    out.counts.push_back(counts);
    out.amplitudes.push_back(amplitudes);
  }
  return out;
}

TEST(RangeNoise, IsMeasuredInTheFramesThemselves) {
  const RangeCamera camera = RangeCamera::Of(BoxRoomRig());
  std::mt19937 random(1);
  std::vector<RangeFrames> views;
  for (const double amplitude : {30.0, 60.0, 120.0, 400.0, 900.0})
    views.push_back(WallFrames(camera, 3, amplitude, 9.0, 0.05, 3, random));
  const RangeNoise noise = RangeNoise::Measure(views, camera);
  ASSERT_TRUE(noise.by_amplitude);
  for (const float A : {40.f, 100.f, 700.f}) {
    const double truth = std::sqrt(9.0 + 0.05 * A) / A;
    EXPECT_NEAR(noise.Sigma(A, 3), truth, 0.06 * truth) << A;
  }
}

TEST(RangeView, FramesAreAveragedAcrossTheWrap) {
  // Half of the values lie below, half above the unambiguous range: a mean of numbers would land at half of
  // it.
  RangeCamera camera = RangeCamera::Of(BoxRoomRig());
  std::mt19937 random(2);
  const RangeFrames frames = WallFrames(camera, camera.wrap_m, 60, 9.0, 0.05, 3, random);
  const RangeNoise noise = RangeNoise::Measure({frames}, camera);
  const RangeView view = MakeRangeView(frames, camera, noise, 60 * 7.5 * 7.5);
  int good = 0, seen = 0;
  for (const float r : view.range_m) {
    seen += r > 0;
    good += std::abs(r - camera.wrap_m) < 5 * noise.Sigma(60, 7);
  }
  EXPECT_GT(seen, 0.95 * static_cast<double>(view.range_m.total()));
  EXPECT_EQ(good, seen);
}

TEST(RangeView, AContradictingFrameIsLeftOut) {
  const RangeCamera camera = RangeCamera::Of(BoxRoomRig());
  std::mt19937 random(3);
  RangeFrames frames = WallFrames(camera, 4, 200, 9.0, 0.05, 5, random);
  const RangeNoise noise = RangeNoise::Measure({frames}, camera);
  frames.counts[1](20, 30) = static_cast<std::uint16_t>(1.5 / camera.unit_m);  // somebody walked by
  EXPECT_NEAR(MakeRangeView(frames, camera, noise, 3200).range_m(20, 30), 4, 4 * noise.Sigma(200, 4));
}

TEST(ResolveWraps, ASurfaceThatRunsThroughTheWrapStaysOne) {
  cv::Mat1f range(20, 60), sigma(20, 60, 0.02f), amplitude(20, 60);
  for (int y = 0; y < 20; ++y) {
    for (int x = 0; x < 60; ++x) {
      const float truth = 6.01f + 0.05f * static_cast<float>(x);
      range(y, x) = truth >= 7.5f ? truth - 7.5f : truth;
      amplitude(y, x) = 3000 / (truth * truth);
    }
  }
  ResolveWraps(range, sigma, amplitude, 7.5f, 3000);
  for (int x = 0; x < 60; ++x) EXPECT_NEAR(range(10, x), 6.01f + 0.05f * static_cast<float>(x), 1e-4);
}

TEST(ResolveWraps, AnIsolatedSurfaceIsPlacedByItsLight) {
  // The same reported 1 m: a wall 8.5 m away returns a hundredth of what one at 1 m does.
  for (const float truth : {1.f, 8.5f}) {
    cv::Mat1f range(10, 10, 1.f), sigma(10, 10, 0.03f), amplitude(10, 10, 3000 / (truth * truth));
    ResolveWraps(range, sigma, amplitude, 7.5f, 3000);
    EXPECT_FLOAT_EQ(range(5, 5), truth);
  }
}

TEST(RemoveMixedPixels, TakesWhatHangsBetweenTwoSurfacesAndNoSlant) {
  cv::Mat1f range(12, 20), sigma(12, 20, 0.02f);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 20; ++x)
      range(y, x) = x < 8 ? 2.f : x == 8 ? 3.1f : 4.f + 0.3f * static_cast<float>(x - 9);
  RemoveMixedPixels(range, sigma);
  for (int y = 1; y < 11; ++y) {
    EXPECT_EQ(range(y, 8), 0) << y;
    for (int x = 10; x < 20; ++x) EXPECT_GT(range(y, x), 0) << x;  // a floor at a grazing angle steps as well
  }
}

}  // namespace
}  // namespace mixstage
