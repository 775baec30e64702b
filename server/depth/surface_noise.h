// SPDX-License-Identifier: Apache-2.0
//
// How noisy a depth picture is, measured in the picture itself: what decides whether a step is noise or an
// edge.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "server/depth/depth_grid.h"
#include "server/depth/depth_signal.h"

namespace mixstage::depth {

// A ToF camera's noise follows the returned light (algorithms 3: sigma ~ sqrt(background + amplitude) /
// amplitude), a triangulating one's the distance: pixels are classed by amplitude where there is one, else by
// z. A class spans a quarter octave.
inline constexpr int kNoiseClasses = 64;
inline int AmplitudeClass(std::uint16_t amplitude) {
  // 1 is class 0, 65535 class 63.
  const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(amplitude));
  const int index = static_cast<int>(bits >> 21) - (127 << 2);
  return index < 0 ? 0 : index >= kNoiseClasses ? kNoiseClasses - 1 : index;
}
inline int DepthClass(float z_m) {
  // 1/64 m is class 0, 1 m class 24, beyond 1 km class 63.
  const int index = static_cast<int>(std::bit_cast<std::uint32_t>(z_m) >> 21) - ((127 - 6) << 2);
  return index < 0 ? 0 : index >= kNoiseClasses ? kNoiseClasses - 1 : index;
}

// Standard deviations, metres, robust (median of absolute values) and of this picture alone, so that a
// picture's result does not depend on those before it.
struct SurfaceNoise {
  bool by_amplitude = false;
  // Of one pixel against the 3x3 median around it, and of that median's step to the next pixel on a plane.
  std::array<float, kNoiseClasses> pixel_m{}, step_m{};
  // What one step of the sensor's own quantisation amounts to, by DepthClass; 0 = finer than matters.
  std::array<float, kNoiseClasses> quantum_m{};
};

// Measures it on at most about 8000 pixels. Holds the memory for that; one owner.
class NoiseMeter {
 public:
  NoiseMeter();
  // raw, amplitude: the sensor's pictures; amplitude may be empty. z, median: of the grid's shape.
  const SurfaceNoise& Measure(const GridShape& shape, ImageView<const std::uint16_t> raw,
                              ImageView<const std::uint16_t> amplitude, const DepthSignal& signal,
                              const GridPicture<float>& z, const GridPicture<float>& median);
  // Of the last Measure.
  [[nodiscard]] const SurfaceNoise& noise() const { return noise_; }

 private:
  static constexpr int kMagnitudes = 128;  // eighths of an octave from 2^-14 m
  using Histogram = std::array<std::array<std::uint16_t, kMagnitudes>, kNoiseClasses>;
  void MeasureQuantum(ImageView<const std::uint16_t> raw, const DepthSignal& signal);
  static void MediansOf(const Histogram& histogram, float to_sigma, std::array<float, kNoiseClasses>& sigma);

  Histogram pixel_{}, step_{};
  std::vector<std::uint16_t> pixels_of_count_;  // 65536, saturating
  SurfaceNoise noise_;
};

}  // namespace mixstage::depth
