// SPDX-License-Identifier: Apache-2.0
//
// One pixel of CG over the camera's picture, inside a loop: whole-number conversions that a compiler can
// inline.
#pragma once

#include <algorithm>
#include <cstdint>

#include "proto/base/srgb.h"
#include "proto/codec/yuv_image.h"

namespace mixstage {

// YcbcrToRgb and RgbToYcbcr (proto/codec/yuv_image.h, the specification) with factors in 1/65536: within one
// level.
[[nodiscard]] inline Rgb8 FixedYcbcrToRgb(int y, int cb, int cr) {
  const auto clamp = [](int value) { return static_cast<std::uint8_t>(std::clamp(value, 0, 255)); };
  constexpr int kHalf = 1 << 15;
  cb -= 128;
  cr -= 128;
  return {clamp(y + ((91881 * cr + kHalf) >> 16)), clamp(y + ((kHalf - 22553 * cb - 46802 * cr) >> 16)),
          clamp(y + ((116130 * cb + kHalf) >> 16))};
}

[[nodiscard]] inline Ycbcr8 FixedRgbToYcbcr(Rgb8 rgb) {
  constexpr int kHalf = 1 << 15;
  const int r = rgb.r, g = rgb.g, b = rgb.b;
  // Pure blue and pure red reach 255.5.
  const auto chroma = [](int value) {
    return static_cast<std::uint8_t>(std::min((value + (128 << 16) + kHalf) >> 16, 255));
  };
  return {static_cast<std::uint8_t>((19595 * r + 38470 * g + 7471 * b + kHalf) >> 16),
          chroma(-11058 * r - 21710 * g + 32768 * b), chroma(32768 * r - 27439 * g - 5329 * b)};
}

// Linear light -> Y'CbCr.
[[nodiscard]] inline Ycbcr8 LinearToYcbcr(const SrgbTables& srgb, float r, float g, float b) {
  return FixedRgbToYcbcr({srgb.ToSrgb(r), srgb.ToSrgb(g), srgb.ToSrgb(b)});
}

}  // namespace mixstage
