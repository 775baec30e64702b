// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

namespace mixstage {

// sRGB's transfer (IEC 61966-2-1), both ways; codes and linear light are 0..1.
[[nodiscard]] inline float LinearOfSrgb(float code) {
  return code <= 0.04045f ? code / 12.92f : std::pow((code + 0.055f) / 1.055f, 2.4f);
}
[[nodiscard]] inline float SrgbOfLinear(float linear) {
  return linear <= 0.0031308f ? 12.92f * linear : 1.055f * std::pow(linear, 1 / 2.4f) - 0.055f;
}

// The same by tables: 8 bit to linear light 0..1 exactly, back by 4096 steps of sqrt(linear), which puts
// the steps where sRGB's own are (error below half a level). Values outside 0..1 are clamped.
class SrgbTables {
 public:
  static const SrgbTables& Get();
  [[nodiscard]] float ToLinear(std::uint8_t code) const { return to_linear_[code]; }
  [[nodiscard]] std::uint8_t ToSrgb(float linear) const {
    const float root = std::sqrt(std::clamp(linear, 0.f, 1.f));
    return to_srgb_[static_cast<std::size_t>(static_cast<int>(root * kSteps + 0.5f))];
  }

 private:
  static constexpr float kSteps = 4096.f;
  SrgbTables();
  std::array<float, 256> to_linear_{};
  std::array<std::uint8_t, 4097> to_srgb_{};
};

}  // namespace mixstage
