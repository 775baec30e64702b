// SPDX-License-Identifier: Apache-2.0
#include "server/depth/depth_signal.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mixstage {
namespace {

DepthCamera Tof() {
  DepthCamera depth;
  depth.camera = {
      .width = 176, .height = 144, .fx = 220, .fy = 221, .cx = 90, .cy = 69, .k1 = -0.25, .k2 = 0.1};
  depth.unit_m = 0.00025;
  depth.unambiguous_range_m = 7.4948;
  depth.range_error = {{1, 2, 3, 7}, {0.01, -0.015, 0.02, 0.0}};
  return depth;
}

cv::Mat1f DepthOf(const DepthSignal& signal, std::uint16_t count) {
  const cv::Mat1w raw(signal.height(), signal.width(), count);
  cv::Mat1f z(raw.size(), -1.0f);
  signal.ToDepth(View(raw), View(z));
  return z;
}

TEST(DepthSignal, RemovesTheRangeErrorAndTurnsRangeIntoZ) {
  const DepthCamera depth = Tof();
  const DepthSignal signal = *DepthSignal::Create(depth, 20);
  for (const double range_m : {0.7, 1.3, 2.0, 2.71, 4.4, 7.2}) {
    const auto count =
        static_cast<std::uint16_t>(std::lround((range_m + depth.range_error.At(range_m)) / depth.unit_m));
    const cv::Mat1f z = DepthOf(signal, count);
    for (const auto& [u, v] : {std::pair{0, 0}, {90, 69}, {175, 20}, {31, 143}}) {
      const Eigen::Vector2d ray = *depth.camera.Unproject({u, v});
      // Half a count of rounding.
      EXPECT_NEAR(z(v, u), range_m / std::sqrt(1 + ray.squaredNorm()), 0.0002) << range_m;
    }
  }
}

TEST(DepthSignal, NoMeasurementBeyondTheUnambiguousRange) {
  const DepthSignal signal = *DepthSignal::Create(Tof(), 20);
  EXPECT_GT(DepthOf(signal, 29979)(69, 90), 7.4f);  // 7.49475 m
  EXPECT_EQ(DepthOf(signal, 29980)(69, 90), 0);     // 7.49500 m
  EXPECT_EQ(DepthOf(signal, 65535)(69, 90), 0);
  EXPECT_EQ(DepthOf(signal, 0)(69, 90), 0);
}

TEST(DepthSignal, ZStaysZAndWildValuesAreUnknown) {
  DepthCamera depth = Tof();
  depth.measures = DepthMeasure::kZ;
  depth.unit_m = 0.001;
  depth.unambiguous_range_m.reset();
  depth.range_error = {};
  const DepthSignal signal = *DepthSignal::Create(depth, 20);
  EXPECT_FLOAT_EQ(DepthOf(signal, 1234)(0, 0), 1.234f);
  EXPECT_FLOAT_EQ(DepthOf(signal, 20000)(0, 0), 20.0f);
  EXPECT_EQ(DepthOf(signal, 20001)(0, 0), 0);
  EXPECT_EQ(DepthOf(signal, 65535)(0, 0), 0);
}

TEST(DepthSignal, PixelsBeyondTheFoldHaveNoDepth) {
  DepthCamera depth = Tof();
  depth.camera.fx = depth.camera.fy = 60;  // the corners lie beyond what k1 = -0.25 can image
  depth.camera.k2 = 0;
  const DepthSignal signal = *DepthSignal::Create(depth, 20);
  const cv::Mat1f z = DepthOf(signal, 8000);
  EXPECT_EQ(z(0, 0), 0);
  EXPECT_GT(z(69, 90), 1.9f);
  for (const float value : z) EXPECT_TRUE(std::isfinite(value));
}

TEST(DepthSignal, NamesWhatIsWrong) {
  DepthCamera depth = Tof();
  depth.camera.cx = std::nan("");
  EXPECT_NE(DepthSignal::Create(depth, 20).error().message.find("cameras.depth"), std::string::npos);
  depth = Tof();
  depth.unit_m = 0;
  EXPECT_NE(DepthSignal::Create(depth, 20).error().message.find("unit_m"), std::string::npos);
  EXPECT_NE(DepthSignal::Create(Tof(), -1).error().message.find("max_depth_m"), std::string::npos);
}

}  // namespace
}  // namespace mixstage
