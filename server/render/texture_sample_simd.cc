// SPDX-License-Identifier: Apache-2.0
//
// SampleTexturesScalar in two steps: where the samples of a vector of fragments lie and what each texel
// counts, a lane a fragment; then the weighted sum of texels, fragment by fragment, its four channels in one
// vector.
#include "server/render/texture_mips.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/texture_sample_simd.cc"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <algorithm>

#include "proto/base/check.h"

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
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;
using DI = hn::RebindToSigned<D>;
using VI = hn::Vec<DI>;
using Four = hn::FixedTag<float, 4>;
using V4 = hn::Vec<Four>;

constexpr std::size_t kLanes = hn::MaxLanes(D());
constexpr std::size_t kMostTaps = 4;

HWY_INLINE V Wrap(V t, TextureWrap wrap) {
  const D d;
  const V one = hn::Set(d, 1.0f);
  if (wrap == TextureWrap::kRepeat) return hn::Sub(t, hn::Floor(t));
  if (wrap == TextureWrap::kClamp) return hn::Min(hn::Max(t, hn::Zero(d)), one);
  const V two = hn::Set(d, 2.0f);
  const V pair = hn::NegMulAdd(two, hn::Floor(hn::Mul(hn::Set(d, 0.5f), t)), t);
  return hn::IfThenElse(hn::Gt(pair, one), hn::Sub(two, pair), pair);
}

// LevelsFor (texture_address.h). Lanes of no fragment may hold anything; they get a level that exists.
struct Levels {
  VI fine, coarse;
  V share_of_coarse;
};
HWY_INLINE Levels LevelsOf(V texels, std::int32_t levels) {
  const D d;
  const DI di;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0f);
  const VI last = hn::Set(di, levels - 1);
  const V rough_log2 = hn::MulAdd(hn::ConvertTo(d, hn::BitCast(di, texels)), hn::Set(d, 1.0f / (1 << 23)),
                                  hn::Set(d, -127.0f));
  const V level = hn::IfThenElseZero(hn::Gt(texels, one), hn::Min(rough_log2, hn::ConvertTo(d, last)));
  const VI whole = hn::ConvertTo(di, level);
  const V share = hn::MulAdd(hn::Set(d, 2.0f), hn::Sub(level, hn::ConvertTo(d, whole)), hn::Set(d, -0.5f));
  const auto next = hn::Ge(share, one);
  const VI fine = hn::Min(
      hn::Max(hn::IfThenElse(hn::RebindMask(di, next), hn::Add(whole, hn::Set(di, 1)), whole), hn::Zero(di)),
      last);
  return {fine, hn::Min(hn::Add(fine, hn::Set(di, 1)), last), hn::IfThenZeroElse(next, hn::Max(share, zero))};
}

// What a vector of fragments takes from one level: the first texel of two above and of two below, and the
// four's weights.
struct Places {
  HWY_ALIGN std::int32_t above[kLanes];
  HWY_ALIGN std::int32_t below[kLanes];
  HWY_ALIGN float weight[4][kLanes];
};

struct LevelSize {
  V width, height;
  VI first, stride;
};
// Neighbours mostly lie in one level, and a gather costs more than all else that is done here.
HWY_INLINE LevelSize SizeOf(const TextureMips::LevelTable& table, VI level) {
  const D d;
  const DI di;
  const auto first = static_cast<std::size_t>(hn::GetLane(level));
  if (hn::AllTrue(di, hn::Eq(level, hn::Set(di, hn::GetLane(level))))) {
    return {hn::Set(d, table.width[first]), hn::Set(d, table.height[first]), hn::Set(di, table.first[first]),
            hn::Set(di, table.stride[first])};
  }
  return {hn::GatherIndex(d, table.width.data(), level), hn::GatherIndex(d, table.height.data(), level),
          hn::GatherIndex(di, table.first.data(), level), hn::GatherIndex(di, table.stride.data(), level)};
}

HWY_INLINE void Find(const LevelSize& size, V s, V t, V share, Places& places) {
  const D d;
  const DI di;
  const V half = hn::Set(d, 0.5f);
  const V x = hn::MulAdd(s, size.width, half);  // counted from the border: never negative
  const V y = hn::MulAdd(t, size.height, half);
  const VI column = hn::ConvertTo(di, x);
  const VI row = hn::ConvertTo(di, y);
  const VI above = hn::Add(size.first, hn::Add(hn::Mul(row, size.stride), column));
  hn::Store(above, di, places.above);
  hn::Store(hn::Add(above, size.stride), di, places.below);
  const V right = hn::Sub(x, hn::ConvertTo(d, column));
  const V lower = hn::Mul(share, hn::Sub(y, hn::ConvertTo(d, row)));
  const V upper = hn::Sub(share, lower);
  const V upper_right = hn::Mul(upper, right);
  const V lower_right = hn::Mul(lower, right);
  hn::Store(hn::Sub(upper, upper_right), d, places.weight[0]);
  hn::Store(upper_right, d, places.weight[1]);
  hn::Store(hn::Sub(lower, lower_right), d, places.weight[2]);
  hn::Store(lower_right, d, places.weight[3]);
}

HWY_INLINE V4 AddTexel(const std::uint16_t* texel, float weight, V4 sum) {
  const hn::FixedTag<std::uint16_t, 4> d16;
  const hn::FixedTag<std::int32_t, 4> d32;
  const V4 value = hn::ConvertTo(Four(), hn::PromoteTo(d32, hn::LoadU(d16, texel)));
  return hn::MulAdd(value, hn::Set(Four(), weight), sum);
}

HWY_INLINE V4 AddPlaces(const std::uint16_t* texels, const Places& places, std::size_t lane, V4 sum) {
  const std::uint16_t* above = texels + 4 * static_cast<std::ptrdiff_t>(places.above[lane]);
  const std::uint16_t* below = texels + 4 * static_cast<std::ptrdiff_t>(places.below[lane]);
  const V4 upper = AddTexel(above + 4, places.weight[1][lane], AddTexel(above, places.weight[0][lane], sum));
  return AddTexel(below + 4, places.weight[3][lane], AddTexel(below, places.weight[2][lane], upper));
}

// All that a vector of fragments takes from its texture.
struct Plan {
  std::size_t count = 0;          // lanes that are fragments
  HWY_ALIGN float blend[kLanes];  // > 0: the coarse level counts, too
  Places fine[kMostTaps];
  Places coarse[kMostTaps];
};

HWY_INLINE void Prefetch(const std::uint16_t* texels, const Places& places, std::size_t count) {
  for (std::size_t lane = 0; lane < count; ++lane) {
    hwy::Prefetch(texels + 4 * static_cast<std::ptrdiff_t>(places.above[lane]));
    hwy::Prefetch(texels + 4 * static_cast<std::ptrdiff_t>(places.below[lane]));
  }
}

// Fragments i.. (no more than count) of this texture; what they will read is on its way afterwards.
HWY_INLINE void MakePlan(const TextureMips& texture, std::size_t i, std::size_t count,
                         const FragmentRows& rows, Plan& plan) {
  using enum FragmentRows::Row;
  const D d;
  auto load = [&](FragmentRows::Row row) { return hn::LoadU(d, rows.row(row) + i); };
  plan.count = std::min(hn::Lanes(d), count);
  const float* taps = rows.row(kTaps) + i;
  const auto most = static_cast<std::size_t>(*std::max_element(taps, taps + plan.count));
  MIX_CHECK(most <= kMostTaps);
  const Levels levels = LevelsOf(load(kTexelsPerTap), static_cast<std::int32_t>(texture.levels().size()));
  hn::Store(levels.share_of_coarse, d, plan.blend);
  const bool blends = *std::max_element(plan.blend, plan.blend + plan.count) > 0;
  const LevelSize fine_size = SizeOf(texture.table(), levels.fine);
  const LevelSize coarse_size = blends ? SizeOf(texture.table(), levels.coarse) : fine_size;
  const V share = hn::Div(hn::Set(d, 1.0f), load(kTaps));
  const V weight = hn::Mul(share, hn::Set(d, 1.0f / 65535.0f));
  const V coarse_weight = hn::Mul(weight, levels.share_of_coarse);
  const V fine_weight = hn::Sub(weight, coarse_weight);
  for (std::size_t k = 0; k < most; ++k) {
    const V along = hn::MulSub(hn::Set(d, static_cast<float>(k) + 0.5f), share, hn::Set(d, 0.5f));
    const V s = Wrap(hn::MulAdd(along, load(kStepU), load(kU)), texture.wrap_u());
    const V t = Wrap(hn::MulAdd(along, load(kStepV), load(kV)), texture.wrap_v());
    Find(fine_size, s, t, fine_weight, plan.fine[k]);
    Prefetch(texture.texels(), plan.fine[k], plan.count);
    if (!blends) continue;
    Find(coarse_size, s, t, coarse_weight, plan.coarse[k]);
    Prefetch(texture.texels(), plan.coarse[k], plan.count);
  }
}

// taps, rgba: of the plan's first fragment.
HWY_INLINE void Follow(const Plan& plan, const std::uint16_t* texels, const float* taps, float* rgba) {
  for (std::size_t lane = 0; lane < plan.count; ++lane) {
    const auto its_taps = static_cast<std::size_t>(taps[lane]);
    V4 sum = hn::Zero(Four());
    for (std::size_t k = 0; k < its_taps; ++k) sum = AddPlaces(texels, plan.fine[k], lane, sum);
    if (plan.blend[lane] > 0) {
      for (std::size_t k = 0; k < its_taps; ++k) sum = AddPlaces(texels, plan.coarse[k], lane, sum);
    }
    hn::StoreU(sum, Four(), rgba + 4 * lane);
  }
}

// Fragments begin..end-1, which all show this texture. Texels come from far memory while the vector before
// is summed.
void SampleRun(const TextureMips& texture, std::size_t begin, std::size_t end, const FragmentRows& rows,
               float* rgba) {
  Plan plans[2];
  std::size_t now = 0;
  MakePlan(texture, begin, end - begin, rows, plans[now]);
  for (std::size_t i = begin; i < end; i += plans[now].count, now = 1 - now) {
    const std::size_t next = i + plans[now].count;
    if (next < end) MakePlan(texture, next, end - next, rows, plans[1 - now]);
    Follow(plans[now], texture.texels(), rows.row(FragmentRows::kTaps) + i, rgba + 4 * i);
  }
}

void SampleTexturesVector(std::span<const TextureMips* const> textures, const FragmentRows& rows,
                          float* rgba) {
  for (std::size_t begin = 0; begin < textures.size();) {
    std::size_t end = begin + 1;
    while (end < textures.size() && textures[end] == textures[begin]) ++end;
    if (textures[begin] == nullptr) {
      std::fill(rgba + 4 * begin, rgba + 4 * end, 1.0f);
    } else {
      SampleRun(*textures[begin], begin, end, rows, rgba);
    }
    begin = end;
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
