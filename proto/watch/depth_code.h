// SPDX-License-Identifier: Apache-2.0
//
// The 10-bit codes of the depth stream's planes (SPEC.md 4.1, stream 2).
#pragma once

#include <algorithm>
#include <cstdint>

namespace mixstage {

inline constexpr int kUnknownDepthCode = 0;
inline constexpr int kFarDepthCode = 1;
inline constexpr int kNearDepthCode = 1023;

// Depths that codes 1023 and 1 stand for: 0 < near_m < far_m.
struct DepthRange {
  float near_m = 0.4f;
  float far_m = 8.0f;
  bool operator==(const DepthRange&) const = default;
};

// Luma: 1/z = 1/far + (code - 1)/1022 (1/near - 1/far). Depths beyond the range get the code of its end; 0,
// NaN and negative depths are unknown (code 0).
[[nodiscard]] inline int DepthToCode(float depth_m, const DepthRange& range) {
  if (!(depth_m > 0)) return kUnknownDepthCode;
  const float inverse_far = 1 / range.far_m;
  const float codes_per_inverse_m = 1022 / (1 / range.near_m - inverse_far);
  const float code = 1 + (1 / depth_m - inverse_far) * codes_per_inverse_m;
  return static_cast<int>(std::clamp(code, 1.0f, 1023.0f) + 0.5f);
}

// Metres of codes 1..1023; 0 = unknown for code 0. Codes beyond 1023 count as 1023.
[[nodiscard]] inline float CodeToDepth(int code, const DepthRange& range) {
  if (code <= kUnknownDepthCode) return 0;
  // In double: a message may hold ranges whose inverse no float holds.
  const double inverse_near = 1 / static_cast<double>(range.near_m),
               inverse_far = 1 / static_cast<double>(range.far_m);
  const double share = (std::min(code, kNearDepthCode) - 1) / 1022.0;
  return static_cast<float>(1 / (inverse_far + share * (inverse_near - inverse_far)));
}

// Cb: coverage of the actor, 4 x alpha.
[[nodiscard]] constexpr int AlphaToCode(std::uint8_t alpha) { return 4 * alpha; }
[[nodiscard]] constexpr std::uint8_t CodeToAlpha(int code) {
  return static_cast<std::uint8_t>(std::clamp((code + 2) / 4, 0, 255));
}

// Cr: the labels that a viewer can tell apart.
enum class WatchLabel {
  kScene = 1,  // background or actor; alpha says which
  kShadow,     // of the actor on the background
  kUnknown,
};
[[nodiscard]] constexpr int LabelToCode(WatchLabel label) {
  return label == WatchLabel::kShadow ? 512 : label == WatchLabel::kUnknown ? 896 : 128;
}
// The nearest of 128, 512 and 896; of two equally near ones the lower.
[[nodiscard]] constexpr WatchLabel CodeToLabel(int code) {
  return code <= 320 ? WatchLabel::kScene : code <= 704 ? WatchLabel::kShadow : WatchLabel::kUnknown;
}
// `process`'s label files: 0 background, 1 actor, 2 shadow, 255 unknown.
[[nodiscard]] constexpr int LabelPixelToCode(std::uint8_t label) {
  return LabelToCode(label == 2     ? WatchLabel::kShadow
                     : label == 255 ? WatchLabel::kUnknown
                                    : WatchLabel::kScene);
}

}  // namespace mixstage
