// SPDX-License-Identifier: Apache-2.0
#include "server/depth/surface_noise.h"

#include <algorithm>
#include <cmath>

namespace mixstage::depth {
namespace {

constexpr int kMostSamples = 8000;
constexpr std::uint32_t kFewestInClass = 40;  // below it neighbouring classes are taken together
// Noise grows at most with the square of the distance (triangulation): by this much in an octave of four
// classes.
constexpr int kOctave = 4;
constexpr float kMostWithinOctave = 4;
constexpr float kSigmaOfMedian = 1.4826f;  // of absolute values, Gaussian

int LatticeStep(double pixels, double most) {
  return std::max(1, static_cast<int>(std::ceil(std::sqrt(pixels / most))));
}

int MagnitudeOf(float metres) {
  const int index = static_cast<int>(std::bit_cast<std::uint32_t>(metres) >> 20) - ((127 - 14) << 3);
  return std::clamp(index, 0, 127);
}
float MetresOfMagnitude(int index) { return std::exp2(-14.0f + (static_cast<float>(index) + 0.5f) / 8.0f); }

}  // namespace

NoiseMeter::NoiseMeter() : pixels_of_count_(1 << 16, 0) {}

const SurfaceNoise& NoiseMeter::Measure(const GridShape& shape, ImageView<const std::uint16_t> raw,
                                        ImageView<const std::uint16_t> amplitude, const DepthSignal& signal,
                                        const GridPicture<float>& z, const GridPicture<float>& median) {
  noise_.by_amplitude = !amplitude.empty();
  for (auto& row : pixel_) row.fill(0);
  for (auto& row : step_) row.fill(0);
  const int lattice = LatticeStep(double{1} * shape.width * shape.height, kMostSamples);
  const std::ptrdiff_t down = shape.stride();
  for (int y = 1; y + 1 < shape.height; y += lattice) {
    const float* measured = z.row(y);
    const float* smooth = median.row(y);
    for (int x = 1; x + 1 < shape.width; x += lattice) {
      const float* m = smooth + x;
      if (!(measured[x] > 0 && m[-1] > 0 && m[1] > 0 && m[-down] > 0 && m[down] > 0)) continue;
      const auto c = static_cast<std::size_t>(noise_.by_amplitude ? AmplitudeClass(amplitude.at(x, y))
                                                                  : DepthClass(m[0]));
      auto count = [&](Histogram& histogram, float metres) {
        ++histogram[c][static_cast<std::size_t>(MagnitudeOf(std::abs(metres)))];
      };
      count(pixel_, measured[x] - m[0]);
      // Second differences: a plane's slope does not count as noise, however steep.
      count(step_, m[-1] - 2 * m[0] + m[1]);
      count(step_, m[-down] - 2 * m[0] + m[down]);
    }
  }
  MediansOf(pixel_, kSigmaOfMedian, noise_.pixel_m);
  // The difference of two steps is what was measured.
  MediansOf(step_, kSigmaOfMedian / std::sqrt(2.0f), noise_.step_m);
  MeasureQuantum(raw, signal);
  return noise_;
}

void NoiseMeter::MediansOf(const Histogram& histogram, float to_sigma,
                           std::array<float, kNoiseClasses>& sigma) {
  std::array<std::uint32_t, kNoiseClasses> total{};
  for (std::size_t c = 0; c < kNoiseClasses; ++c) {
    for (const std::uint32_t n : histogram[c]) total[c] += n;
  }
  // Of classes low..high together, which hold so many samples.
  auto median_m = [&](int low, int high, std::uint32_t samples) {
    std::uint32_t below = 0;
    int k = 0;
    for (; k + 1 < kMagnitudes; ++k) {
      for (int n = low; n <= high; ++n)
        below += histogram[static_cast<std::size_t>(n)][static_cast<std::size_t>(k)];
      if (2 * below >= samples) break;
    }
    return MetresOfMagnitude(k);
  };
  for (int c = 0; c < kNoiseClasses; ++c) {
    if (total[static_cast<std::size_t>(c)] == 0) continue;
    // A class with few pixels borrows from those beside it, the nearest first.
    int low = c;
    int high = c;
    std::uint32_t samples = total[static_cast<std::size_t>(c)];
    while (samples < kFewestInClass && (low > 0 || high + 1 < kNoiseClasses)) {
      if (low > 0) samples += total[static_cast<std::size_t>(--low)];
      if (high + 1 < kNoiseClasses) samples += total[static_cast<std::size_t>(++high)];
    }
    const float own_m = median_m(low, high, samples);
    // Some classes hold nothing but the mixed pixels between two surfaces: they may not call that noise.
    low = std::max(0, c - kOctave);
    high = std::min(kNoiseClasses - 1, c + kOctave);
    samples = 0;
    for (int n = low; n <= high; ++n) samples += total[static_cast<std::size_t>(n)];
    sigma[static_cast<std::size_t>(c)] =
        to_sigma * std::min(own_m, kMostWithinOctave * median_m(low, high, samples));
  }
  // Classes that the samples missed: as the nearest that they did not.
  for (int c = 0; c < kNoiseClasses; ++c) {
    if (total[static_cast<std::size_t>(c)] != 0) continue;
    float& value = sigma[static_cast<std::size_t>(c)];
    value = 0;
    for (int away = 1; away < kNoiseClasses && value == 0; ++away) {
      for (const int other : {c - away, c + away}) {
        const bool there = other >= 0 && other < kNoiseClasses && total[static_cast<std::size_t>(other)] != 0;
        if (there && value == 0) value = sigma[static_cast<std::size_t>(other)];
      }
    }
  }
}

// A sensor that quantises leaves gaps between the counts it uses, and many pixels on each that it uses: on a
// stair of equal values the medians above are 0, while the stairs themselves are steps.
void NoiseMeter::MeasureQuantum(ImageView<const std::uint16_t> raw, const DepthSignal& signal) {
  std::fill(pixels_of_count_.begin(), pixels_of_count_.end(), std::uint16_t{0});
  const int lattice = LatticeStep(double{1} * raw.width() * raw.height(), kMostSamples);
  std::uint16_t largest = 0;
  for (int y = 0; y < raw.height(); y += lattice) {
    const std::uint16_t* counts = raw.row(y);
    for (int x = 0; x < raw.width(); x += lattice) {
      largest = std::max(largest, counts[x]);
      std::uint16_t& n = pixels_of_count_[counts[x]];
      n = static_cast<std::uint16_t>(n + (n < 0xffff));
    }
  }
  std::array<std::uint32_t, kNoiseClasses> pixels{}, values{};
  std::array<float, kNoiseClasses> first{}, last{};
  for (std::size_t count = 1; count <= largest; ++count) {
    if (pixels_of_count_[count] == 0) continue;
    const float metres = signal.MetresOf(static_cast<std::uint16_t>(count));
    if (!(metres > 0)) continue;
    const auto c = static_cast<std::size_t>(DepthClass(metres));
    if (values[c]++ == 0) first[c] = metres;
    last[c] = metres;
    pixels[c] += pixels_of_count_[count];
  }
  for (std::size_t c = 0; c < kNoiseClasses; ++c) {
    // With few pixels a value the gaps say nothing of the sensor.
    const bool known = values[c] >= 3 && pixels[c] >= 4 * values[c];
    noise_.quantum_m[c] = known ? (last[c] - first[c]) / static_cast<float>(values[c] - 1) : 0.0f;
  }
}

}  // namespace mixstage::depth
