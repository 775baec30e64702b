// SPDX-License-Identifier: Apache-2.0
//
// Shared by the scalar loop and its SIMD twin.
#pragma once

namespace mixstage {

// Real sensors and JPEG have heavier tails than a Gaussian: its exponent counts half (room) or two thirds
// (shadow).
inline constexpr float kColorTail = 0.25f;
inline constexpr float kShadowTail = 0.35f;
inline constexpr float kFarthest = 400.0f;  // squared sigmas; beyond, the byte is saturated anyway
// Where the tone change moved a value by n levels, the model of that change may be wrong by this share of n.
inline constexpr float kToneDoubt = 0.15f;
// From here on the camera may have clipped.
inline constexpr float kClipped = 246.0f;
// Brighter than the room is no shadow.
inline constexpr float kBrighter = 0.98f;
inline constexpr float kBrighterCost = 60.0f;

}  // namespace mixstage
