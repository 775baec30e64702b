// SPDX-License-Identifier: Apache-2.0
#include "server/depth/surface_cut.h"

#include <algorithm>
#include <cmath>

#include "server/depth/surface_rows.h"

namespace mixstage::depth {
namespace {

// Steps smaller than this separate no two things that keying could tell apart.
constexpr float kLeastStep_m = 0.01f;
constexpr float kLeastStepShare = 0.005f;  // of z
constexpr float kQuantaInStep = 2.5f;
// A class of amplitude whose pixels scatter this much measures nothing.
constexpr float kUselessNoise_m = 0.5f;

}  // namespace

SurfaceCut::SurfaceCut(const DepthSignal& signal, const SurfaceCutConfig& config)
    : shape_{signal.width(), signal.height()},
      config_(config),
      z_(shape_),
      median_(shape_),
      step_limit_(shape_),
      pixel_limit_(shape_),
      valid_(shape_),
      cut_right_(shape_),
      cut_down_(shape_),
      cells_(shape_) {
  // In the middle of the picture; lenses bend it by less than the slopes above are rough.
  const cv::Vec2f& middle = signal.rays()(shape_.height / 2, shape_.width / 2);
  const cv::Vec2f& beside = signal.rays()(shape_.height / 2, std::max(0, shape_.width / 2 - 1));
  const float pitch = std::hypot(middle[0] - beside[0], middle[1] - beside[1]);
  pitch_ = std::isfinite(pitch) && pitch > 0 ? pitch : 0.005f;
}

void SurfaceCut::Run(const DepthSignal& signal, ImageView<const std::uint16_t> raw,
                     ImageView<const std::uint16_t> amplitude) {
  signal.ToDepth(raw, z_.View());
  for (int y = 0; y < shape_.height; ++y) {
    MedianRow(z_.row(y - 1), z_.row(y), z_.row(y + 1), shape_.width, median_.row(y));
  }
  meter_.Measure(shape_, raw, amplitude, signal, z_, median_);
  SetLimits(amplitude);
  for (int y = 0; y < shape_.height; ++y) {
    CutRow(median_.row(y), step_limit_.row(y), 1, pitch_, shape_.width, cut_right_.row(y));
    // The rows before the first and after the last of the picture are border, which counts as holes.
    if (y + 1 < shape_.height) {
      CutRow(median_.row(y), step_limit_.row(y), shape_.stride(), pitch_, shape_.width, cut_down_.row(y));
    }
  }
  SetCells();
}

void SurfaceCut::SetLimits(ImageView<const std::uint16_t> amplitude) {
  const SurfaceNoise& noise = meter_.noise();
  std::array<float, kNoiseClasses> step{}, pixel{}, least{};
  for (std::size_t c = 0; c < kNoiseClasses; ++c) {
    step[c] = config_.step_sigmas * noise.step_m[c];
    pixel[c] = config_.pixel_sigmas * noise.pixel_m[c];
    if (noise.by_amplitude && noise.pixel_m[c] > kUselessNoise_m) pixel[c] = -1;
    least[c] = kLeastStep_m + kQuantaInStep * noise.quantum_m[c];
  }
  const int width = shape_.width;
  for (int y = 0; y < shape_.height; ++y) {
    const float* z = z_.row(y);
    const float* median = median_.row(y);
    const std::uint16_t* a = noise.by_amplitude ? amplitude.row(y) : nullptr;
    float* step_limit = step_limit_.row(y);
    float* pixel_limit = pixel_limit_.row(y);
    std::uint8_t* valid = valid_.row(y);
    for (int x = 0; x < width; ++x) {
      const auto by_depth = static_cast<std::size_t>(DepthClass(median[x]));
      const auto c = a != nullptr ? static_cast<std::size_t>(AmplitudeClass(a[x])) : by_depth;
      const float floor = least[by_depth] + kLeastStepShare * median[x];
      step_limit[x] = std::max(step[c], floor);
      const bool useless = pixel[c] < 0 || (a != nullptr && a[x] == 0);
      pixel_limit[x] = useless ? -1.0f : std::max(pixel[c], floor);
    }
    for (int x = 0; x < width; ++x) {
      const bool good = z[x] > 0 && std::abs(z[x] - median[x]) <= pixel_limit[x];
      valid[x] = good ? 255 : 0;
    }
  }
}

void SurfaceCut::SetCells() {
  const int width = shape_.width;
  for (int y = 0; y + 1 < shape_.height; ++y) {
    const std::uint8_t* above = valid_.row(y);
    const std::uint8_t* below = valid_.row(y + 1);
    const std::uint8_t* cut_above = cut_right_.row(y);
    const std::uint8_t* cut_below = cut_right_.row(y + 1);
    const std::uint8_t* cut_down = cut_down_.row(y);
    std::uint8_t* cells = cells_.row(y);
    // Bytes, no branches and a bound that stores cannot change, so that compilers make vectors of it.
    for (int x = 0; x < width - 1; ++x) {
      const auto top = static_cast<std::uint8_t>(above[x] & above[x + 1] & ~cut_above[x]);
      const auto bottom = static_cast<std::uint8_t>(below[x] & below[x + 1] & ~cut_below[x]);
      const auto left = static_cast<std::uint8_t>(above[x] & below[x] & ~cut_down[x]);
      const auto right = static_cast<std::uint8_t>(above[x + 1] & below[x + 1] & ~cut_down[x + 1]);
      const auto upper = static_cast<std::uint8_t>(top & left);
      const auto lower = static_cast<std::uint8_t>(bottom & right);
      const auto turned_upper = static_cast<std::uint8_t>(top & right & ~(upper | lower));
      const auto turned_lower = static_cast<std::uint8_t>(bottom & left & ~(upper | lower));
      const auto any = static_cast<std::uint8_t>(above[x] | above[x + 1] | below[x] | below[x + 1]);
      cells[x] = static_cast<std::uint8_t>(
          ((upper | turned_upper) & kUpper) | ((lower | turned_lower) & kLower) |
          ((turned_upper | turned_lower) & kTurned) | (any & ~(upper & lower) & kTorn));
    }
  }
}

}  // namespace mixstage::depth
