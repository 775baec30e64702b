// SPDX-License-Identifier: Apache-2.0
//
// SampleTexturesScalar with the four channels of a texel in one vector.
#include "server/render/texture_mips.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/texture_sample_simd.cc"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "proto/base/check.h"
#include "server/render/texture_address.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

#if HWY_TARGET == HWY_SCALAR  // has no vectors of four

void SampleTexturesVector(std::span<const TextureMips* const> textures, const FragmentRows& rows,
                          float* rgba) {
  SampleTexturesScalar(textures, rows, rgba);
}

#else

namespace hn = hwy::HWY_NAMESPACE;
using Four = hn::FixedTag<float, 4>;
using V = hn::Vec<Four>;

constexpr std::size_t kAhead = 8;  // fragments

HWY_INLINE V Texel(const std::uint16_t* texel) {
  const hn::FixedTag<std::uint16_t, 4> d16;
  const hn::FixedTag<std::int32_t, 4> d32;
  return hn::ConvertTo(Four(), hn::PromoteTo(d32, hn::LoadU(d16, texel)));
}

HWY_INLINE V Mix(V a, V b, float share_of_b) {
  return hn::MulAdd(hn::Set(Four(), share_of_b), hn::Sub(b, a), a);
}

HWY_INLINE V Bilinear(const TextureMips::Level& level, float s, float t) {
  const TexelPlace x = PlaceOf(s, level.width);
  const TexelPlace y = PlaceOf(t, level.height);
  const std::uint16_t* upper = level.texel(x.first, y.first);
  const std::uint16_t* lower = upper + 4 * static_cast<std::ptrdiff_t>(level.stride);
  return Mix(Mix(Texel(upper), Texel(upper + 4), x.share_of_next),
             Mix(Texel(lower), Texel(lower + 4), x.share_of_next), y.share_of_next);
}

HWY_INLINE V SampleOnce(const TextureMips& texture, const LevelPair& pair, float u, float v) {
  const float s = WrapCoordinate(u, texture.wrap_u());
  const float t = WrapCoordinate(v, texture.wrap_v());
  const TextureMips::Level* level = texture.levels().data() + pair.fine;
  const V fine = Bilinear(level[0], s, t);
  if (!(pair.share_of_coarse > 0)) return fine;
  return Mix(fine, Bilinear(level[1], s, t), pair.share_of_coarse);
}

void SampleTexturesVector(std::span<const TextureMips* const> textures, const FragmentRows& rows,
                          float* rgba) {
  using enum FragmentRows::Row;
  const Four d;
  const float* u = rows.row(kU);
  const float* v = rows.row(kV);
  const float* step_u = rows.row(kStepU);
  const float* step_v = rows.row(kStepV);
  const float* all_taps = rows.row(kTaps);
  const float* texels = rows.row(kTexelsPerTap);
  for (std::size_t i = 0; i < textures.size(); ++i) {
    if (textures[i] == nullptr) {
      hn::StoreU(hn::Set(d, 1.0f), d, rgba + 4 * i);
      continue;
    }
    const TextureMips& texture = *textures[i];
    // The texels of fragments to come are fetched while this one is filtered.
    if (i + kAhead < textures.size() && textures[i + kAhead] == textures[i]) {
      const std::size_t next = i + kAhead;
      const LevelPair pair = LevelsFor(texels[next], static_cast<int>(texture.levels().size()));
      const TextureMips::Level& level = texture.levels()[static_cast<std::size_t>(pair.fine)];
      const TexelPlace x = PlaceOf(WrapCoordinate(u[next], texture.wrap_u()), level.width);
      const TexelPlace y = PlaceOf(WrapCoordinate(v[next], texture.wrap_v()), level.height);
      hwy::Prefetch(level.texel(x.first, y.first));
      hwy::Prefetch(level.texel(x.first, y.first + 1));
    }
    const LevelPair pair = LevelsFor(texels[i], static_cast<int>(texture.levels().size()));
    const float share = 1.0f / all_taps[i];
    V sum = hn::Zero(d);
    for (float k = 0; k < all_taps[i]; ++k) {
      const float along = (k + 0.5f) * share - 0.5f;
      sum = hn::Add(sum, SampleOnce(texture, pair, u[i] + along * step_u[i], v[i] + along * step_v[i]));
    }
    hn::StoreU(hn::Mul(sum, hn::Set(d, share / 65535.0f)), d, rgba + 4 * i);
  }
}

#endif

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(SampleTexturesVector);

void SampleTextures(std::span<const TextureMips* const> textures, const FragmentRows& rows, float* rgba) {
  MIX_CHECK(textures.size() <= rows.capacity());
  HWY_DYNAMIC_DISPATCH(SampleTexturesVector)(textures, rows, rgba);
}

}  // namespace mixstage
#endif
