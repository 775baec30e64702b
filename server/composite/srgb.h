// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace mixstage {

// sRGB transfer by tables: 8 bit to linear light 0..1 exactly, back by 4096 steps of sqrt(linear), which puts the
// steps where sRGB's own are (error below half a level). Values outside 0..1 are clamped.
class SrgbTables {
 public:
  static const SrgbTables& Get();
  [[nodiscard]] float ToLinear(std::uint8_t code) const { return to_linear_[code]; }
  [[nodiscard]] std::uint8_t ToSrgb(float linear) const;

 private:
  SrgbTables();
  std::array<float, 256> to_linear_{};
  std::array<std::uint8_t, 4097> to_srgb_{};
};

}  // namespace mixstage
