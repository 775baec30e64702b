// SPDX-License-Identifier: Apache-2.0
//
// ColorSurfaceScalar for as many fragments at once as the machine's vectors hold; the last vector runs into
// the fragments after the surface, which are coloured later.
#include "server/render/surface_color.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/surface_color_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "proto/base/check.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

void ColorSurfaceVector(const Material& material, std::size_t begin, std::size_t end,
                        const FragmentRows& rows, const float* texture_rgba, float* rgba) {
  using enum FragmentRows::Row;
  const D d;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0f);
  const V metallic = hn::Set(d, material.metallic);
  const V matt = hn::Set(d, 1.0f - material.metallic);
  const V dielectric = hn::Set(d, material.head_on);
  const V mask_gain = hn::Set(d, kMaskSlope * material.base_alpha);
  const V mask_offset = hn::Set(d, 0.5f - kMaskSlope * material.alpha_cutoff);
  for (std::size_t i = begin; i < end; i += hn::Lanes(d)) {
    auto load = [&](FragmentRows::Row row) { return hn::LoadU(d, rows.row(row) + i); };
    V r, g, b, a;
    hn::LoadInterleaved4(d, texture_rgba + 4 * i, r, g, b, a);
    V coverage = load(kShare);
    if (material.alpha_mask) {
      const V ramp = hn::MulAdd(mask_gain, a, mask_offset);
      coverage = hn::Mul(coverage, hn::Min(hn::Max(ramp, zero), one));
    }
    auto color = [&](V texel, float base, V diffuse, V specular) {
      const V albedo = hn::Mul(hn::Set(d, base), texel);
      const V mirror = hn::MulAdd(metallic, hn::Sub(albedo, dielectric), dielectric);
      const V scattered = hn::Mul(hn::Mul(matt, albedo), diffuse);
      return hn::Mul(coverage, hn::MulAdd(mirror, specular, scattered));
    };
    hn::StoreInterleaved4(color(r, material.base_color.x(), load(kDiffuseR), load(kSpecularR)),
                          color(g, material.base_color.y(), load(kDiffuseG), load(kSpecularG)),
                          color(b, material.base_color.z(), load(kDiffuseB), load(kSpecularB)), coverage, d,
                          rgba + 4 * i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(ColorSurfaceVector);

void ColorSurface(const Material& material, std::size_t begin, std::size_t end, const FragmentRows& rows,
                  const float* texture_rgba, float* rgba) {
  MIX_CHECK(begin <= end && end <= rows.capacity());
  HWY_DYNAMIC_DISPATCH(ColorSurfaceVector)(material, begin, end, rows, texture_rgba, rgba);
}

}  // namespace mixstage
#endif
