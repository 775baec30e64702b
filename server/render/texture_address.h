// SPDX-License-Identifier: Apache-2.0
//
// Where a texture coordinate lies between texels: the specification that the vector sampler follows.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "server/scene/mesh.h"

namespace mixstage {

// |x| < 2^31. std::floor is a call on the baseline machine.
inline float FloorOf(float x) {
  const auto whole = static_cast<float>(static_cast<std::int32_t>(x));
  return whole > x ? whole - 1.0f : whole;
}

// A texture coordinate (|t| <= 2e6) into 0..1.
inline float WrapCoordinate(float t, TextureWrap wrap) {
  if (wrap == TextureWrap::kRepeat) return t - FloorOf(t);
  if (wrap == TextureWrap::kClamp) return std::min(std::max(t, 0.0f), 1.0f);
  const float pair = t - 2.0f * FloorOf(0.5f * t);  // 0..2
  return pair > 1.0f ? 2.0f - pair : pair;
}

// The texel whose centre is at or before t (0..1), -1 for the border, and the share of the one after it.
struct TexelPlace {
  int first;
  float share_of_next;
};
inline TexelPlace PlaceOf(float t, int size) {
  const float at = t * static_cast<float>(size) + 0.5f;  // counted from the border: never negative
  const int from_border = static_cast<int>(at);
  return {from_border - 1, at - static_cast<float>(from_border)};
}

// log2 within 0.09: the mantissa taken as its own logarithm. A level of detail needs no more.
inline float RoughLog2(float x) {
  return static_cast<float>(std::bit_cast<std::int32_t>(x)) * (1.0f / (1 << 23)) - 127.0f;
}

// The levels that a sample of so many level 0 texels is taken from. Around whole levels one alone serves; the
// blend to the next takes the middle half of the way.
struct LevelPair {
  int fine;
  float share_of_coarse;  // 0: the fine one alone
};
inline LevelPair LevelsFor(float texels, int levels) {
  if (!(texels > 1.0f)) return {0, 0.0f};
  const float level = RoughLog2(texels);
  if (level >= static_cast<float>(levels - 1)) return {levels - 1, 0.0f};
  const int fine = static_cast<int>(level);
  const float share = 2.0f * (level - static_cast<float>(fine)) - 0.5f;
  if (share >= 1.0f) return {fine + 1, 0.0f};
  return {fine, std::max(share, 0.0f)};
}

}  // namespace mixstage
