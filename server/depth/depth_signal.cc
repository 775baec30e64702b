// SPDX-License-Identifier: Apache-2.0
#include "server/depth/depth_signal.h"

#include <cmath>

namespace mixstage {

Result<DepthSignal> DepthSignal::Create(const DepthCamera& depth, double max_depth_m) {
  if (auto ok = depth.camera.Validate(); !ok) {
    return Within("cameras.depth", {ErrorCode::kInvalidConfig, ok.error().message});
  }
  if (!(depth.unit_m > 0 && depth.unit_m <= 1)) {
    return Fail(ErrorCode::kInvalidConfig, "cameras.depth.unit_m is outside 0..1 m per count");
  }
  if (!(max_depth_m > 0 && max_depth_m <= 1000)) {
    return Fail(ErrorCode::kInvalidConfig, "max_depth_m is outside 0..1000 m");
  }
  DepthSignal signal;
  signal.max_depth_m_ = static_cast<float>(max_depth_m);
  constexpr int kCounts = 1 << 16;
  signal.metres_of_count_.assign(kCounts, 0.0f);
  for (int count = 1; count < kCounts; ++count) {
    const double reported_m = count * depth.unit_m;
    if (depth.unambiguous_range_m && reported_m >= *depth.unambiguous_range_m) break;
    const double true_m = depth.range_error.TrueRange(reported_m);
    if (true_m > 0) signal.metres_of_count_[static_cast<std::size_t>(count)] = static_cast<float>(true_m);
  }
  signal.rays_ = UnprojectionTable(depth.camera);
  signal.z_per_metre_ = cv::Mat1f(signal.rays_.size(), 0.0f);
  for (int y = 0; y < signal.rays_.rows; ++y) {
    for (int x = 0; x < signal.rays_.cols; ++x) {
      const cv::Vec2f& ray = signal.rays_(y, x);
      if (!std::isfinite(ray[0]) || !std::isfinite(ray[1])) continue;
      signal.z_per_metre_(y, x) = depth.measures == DepthMeasure::kRange
                                      ? 1.0f / std::sqrt(1 + ray[0] * ray[0] + ray[1] * ray[1])
                                      : 1.0f;
    }
  }
  return signal;
}

void DepthSignal::ToDepth(ImageView<const std::uint16_t> raw, ImageView<float> z_m) const {
  MIX_CHECK(raw.width() == width() && raw.height() == height() && z_m.width() == width() &&
            z_m.height() == height());
  for (int y = 0; y < height(); ++y) {
    const std::uint16_t* counts = raw.row(y);
    const float* scale = z_per_metre_.ptr<float>(y);
    float* z = z_m.row(y);
    for (int x = 0; x < width(); ++x) {
      const float metres = metres_of_count_[counts[x]] * scale[x];
      z[x] = metres <= max_depth_m_ ? metres : 0.0f;
    }
  }
}

}  // namespace mixstage
