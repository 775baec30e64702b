// SPDX-License-Identifier: Apache-2.0
//
// Noise to make procedural materials of; every function is pure and the same on every machine.
#pragma once

#include <cmath>
#include <cstdint>

namespace mixstage {

// A well mixed 32-bit hash (the finaliser of MurmurHash3).
[[nodiscard]] inline std::uint32_t Mix(std::uint32_t h) {
  h ^= h >> 16;
  h *= 0x85ebca6bu;
  h ^= h >> 13;
  h *= 0xc2b2ae35u;
  return h ^ (h >> 16);
}
[[nodiscard]] inline std::uint32_t Mix(std::uint32_t a, std::uint32_t b) {
  return Mix(a ^ Mix(b + 0x9e3779b9u));
}

// 0..1, one value per pair of integers.
[[nodiscard]] inline float Unit(int a, int b) {
  const auto h = Mix(static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b));
  return static_cast<float>(h >> 8) * 0x1p-24f;
}

// Smooth noise 0..1 with features of size 1.
[[nodiscard]] inline float ValueNoise(double x, double y) {
  const double fx = std::floor(x);
  const double fy = std::floor(y);
  const int ix = static_cast<int>(fx);
  const int iy = static_cast<int>(fy);
  auto ease = [](double t) { return static_cast<float>(t * t * (3 - 2 * t)); };
  const float u = ease(x - fx);
  const float v = ease(y - fy);
  const float low = Unit(ix, iy) + u * (Unit(ix + 1, iy) - Unit(ix, iy));
  const float high = Unit(ix, iy + 1) + u * (Unit(ix + 1, iy + 1) - Unit(ix, iy + 1));
  return low + v * (high - low);
}

// Three octaves, 0..1.
[[nodiscard]] inline float Fbm(double x, double y) {
  return 0.55f * ValueNoise(x, y) + 0.29f * ValueNoise(2.1 * x + 7.3, 2.1 * y - 3.1) +
         0.16f * ValueNoise(4.3 * x - 1.7, 4.3 * y + 9.2);
}

[[nodiscard]] inline float SmoothStep(float from, float to, float x) {
  const float t = std::fmin(std::fmax((x - from) / (to - from), 0.f), 1.f);
  return t * t * (3 - 2 * t);
}

}  // namespace mixstage
