// SPDX-License-Identifier: Apache-2.0
//
// ShadeLightsScalar for as many fragments at once as the machine's vectors hold. The rows are padded
// (FragmentRows), so the last vector runs over count; what it writes there is never read.
#include "server/render/shade_lights.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/shade_lights_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "proto/base/check.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

struct V3 {
  V x, y, z;
};
HWY_INLINE V Dot(const V3& a, const V3& b) {
  return hn::MulAdd(a.x, b.x, hn::MulAdd(a.y, b.y, hn::Mul(a.z, b.z)));
}
HWY_INLINE V3 Times(const V3& a, V s) { return {hn::Mul(a.x, s), hn::Mul(a.y, s), hn::Mul(a.z, s)}; }
HWY_INLINE V3 Broadcast(const Eigen::Vector3f& a) {
  const D d;
  return {hn::Set(d, a.x()), hn::Set(d, a.y()), hn::Set(d, a.z())};
}
HWY_INLINE V InverseLength(const V3& a) {
  const D d;
  return hn::Div(hn::Set(d, 1.0f), hn::Sqrt(hn::Max(Dot(a, a), hn::Set(d, 1e-30f))));
}

struct Surface {
  V3 p, n, view;
  V shininess, specular_gain;
};
struct Sums {
  V3 diffuse, specular;
};

HWY_INLINE void AddLamp(const CameraLight& lamp, const Surface& s, Sums& sums) {
  const D d;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0f);
  V3 toward = Broadcast(lamp.vector);
  V share = one;
  if (lamp.kind != CameraLight::Kind::kDirectional) {
    toward = {hn::Sub(toward.x, s.p.x), hn::Sub(toward.y, s.p.y), hn::Sub(toward.z, s.p.z)};
    const V d2 = hn::Max(Dot(toward, toward), hn::Set(d, 1e-6f));
    toward = Times(toward, hn::Div(one, hn::Sqrt(d2)));
    if (lamp.kind == CameraLight::Kind::kPoint) {
      share = hn::Div(one, d2);
    } else {
      const V cosine = hn::Max(zero, hn::Neg(Dot(Broadcast(lamp.normal), toward)));
      share = hn::Div(cosine, hn::MulAdd(hn::Set(d, static_cast<float>(M_PI)), d2, hn::Set(d, lamp.area)));
    }
  }
  const V received = hn::Mul(share, hn::Max(zero, Dot(s.n, toward)));
  const V3 half = {hn::Add(toward.x, s.view.x), hn::Add(toward.y, s.view.y), hn::Add(toward.z, s.view.z)};
  const V c = hn::Max(zero, hn::Mul(Dot(s.n, half), InverseLength(half)));
  const V lobe = hn::Div(c, hn::Add(hn::NegMulAdd(s.shininess, c, s.shininess), c));
  const V mirrored = hn::Mul(hn::Mul(received, s.specular_gain), lobe);
  const V3 strength = Broadcast(lamp.strength);
  sums.diffuse = {hn::MulAdd(received, strength.x, sums.diffuse.x),
                  hn::MulAdd(received, strength.y, sums.diffuse.y),
                  hn::MulAdd(received, strength.z, sums.diffuse.z)};
  sums.specular = {hn::MulAdd(mirrored, strength.x, sums.specular.x),
                   hn::MulAdd(mirrored, strength.y, sums.specular.y),
                   hn::MulAdd(mirrored, strength.z, sums.specular.z)};
}

// x (t1 + t4 x + t7 y + t8 z) + y (t2 + t5 y + t9 z) + z (t3 + t6 z) + t0
HWY_INLINE V AmbientOf(const std::array<float, AmbientLight::kTerms>& t, const V3& n) {
  const D d;
  auto term = [&](std::size_t i) { return hn::Set(d, t[i]); };
  const V of_x = hn::MulAdd(n.x, term(4), hn::MulAdd(n.y, term(7), hn::MulAdd(n.z, term(8), term(1))));
  const V of_y = hn::MulAdd(n.y, term(5), hn::MulAdd(n.z, term(9), term(2)));
  const V of_z = hn::MulAdd(n.z, term(6), term(3));
  return hn::Max(hn::Zero(d), hn::MulAdd(n.x, of_x, hn::MulAdd(n.y, of_y, hn::MulAdd(n.z, of_z, term(0)))));
}

void ShadeLightsVector(const CameraIllumination& light, std::size_t count, FragmentRows& rows) {
  using enum FragmentRows::Row;
  const D d;
  auto load = [&](FragmentRows::Row row, std::size_t i) { return hn::LoadU(d, rows.row(row) + i); };
  auto store = [&](const V3& v, FragmentRows::Row first, std::size_t i) {
    hn::StoreU(v.x, d, rows.row(first) + i);
    hn::StoreU(v.y, d, rows.row(static_cast<FragmentRows::Row>(first + 1)) + i);
    hn::StoreU(v.z, d, rows.row(static_cast<FragmentRows::Row>(first + 2)) + i);
  };
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    Surface s;
    s.p = {load(kX, i), load(kY, i), load(kZ, i)};
    const V3 n = {load(kNx, i), load(kNy, i), load(kNz, i)};
    s.n = Times(n, InverseLength(n));
    s.view = Times(s.p, hn::Neg(InverseLength(s.p)));
    s.shininess = load(kShininess, i);
    s.specular_gain = hn::Mul(hn::Set(d, 0.125f), hn::Add(s.shininess, hn::Set(d, 8.0f)));
    const V3 ambient = {AmbientOf(light.ambient.terms[0], s.n), AmbientOf(light.ambient.terms[1], s.n),
                        AmbientOf(light.ambient.terms[2], s.n)};
    Sums sums{ambient, ambient};
    for (const CameraLight& lamp : light.lights) AddLamp(lamp, s, sums);
    store(s.n, kNx, i);
    store(sums.diffuse, kDiffuseR, i);
    store(sums.specular, kSpecularR, i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(ShadeLightsVector);

void ShadeLights(const CameraIllumination& light, std::size_t count, FragmentRows& rows) {
  MIX_CHECK(count <= rows.capacity());
  HWY_DYNAMIC_DISPATCH(ShadeLightsVector)(light, count, rows);
}

}  // namespace mixstage
#endif
