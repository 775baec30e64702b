// SPDX-License-Identifier: Apache-2.0
//
// InterpolateScalar for as many fragments at once as the machine's vectors hold; the last vector runs into
// the rows' padding.
#include "server/render/interpolate.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/interpolate_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "proto/base/check.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::ScalableTag<float>;
using V = hn::Vec<D>;

namespace {

struct V3 {
  V x, y, z;
};
struct V4 {
  V x, y, z, w;
};
HWY_INLINE V4 LoadCorner(const float* from) {
  V4 v;
  hn::LoadInterleaved4(D(), from, v.x, v.y, v.z, v.w);
  return v;
}
HWY_INLINE V3 Cross(const V3& a, const V3& b) {
  return {hn::MulSub(a.y, b.z, hn::Mul(a.z, b.y)), hn::MulSub(a.z, b.x, hn::Mul(a.x, b.z)),
          hn::MulSub(a.x, b.y, hn::Mul(a.y, b.x))};
}
HWY_INLINE V4 Minus(const V4& a, const V4& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z), hn::Sub(a.w, b.w)};
}
HWY_INLINE V Blend3(V base, V b, V one, V c, V two) { return hn::MulAdd(b, one, hn::MulAdd(c, two, base)); }

}  // namespace

void InterpolateVector(float pixel_rad, std::size_t count, FragmentRows& rows) {
  using enum FragmentRows::Row;
  const D d;
  const V zero = hn::Zero(d);
  const V beside = hn::Set(d, -0.1f);
  const V one = hn::Set(d, 1.0f);
  const V tiny = hn::Set(d, 1e-12f);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    auto load = [&](FragmentRows::Row row) { return hn::LoadU(d, rows.row(row) + i); };
    auto store = [&](V v, FragmentRows::Row row) { hn::StoreU(v, d, rows.row(row) + i); };
    const V4 v0 = LoadCorner(rows.corner(0) + 4 * i);
    const V4 v1 = Minus(LoadCorner(rows.corner(1) + 4 * i), v0);
    const V4 v2 = Minus(LoadCorner(rows.corner(2) + 4 * i), v0);
    const V3 p0{v0.x, v0.y, v0.z};
    const V3 e1{v1.x, v1.y, v1.z};
    const V3 e2{v2.x, v2.y, v2.z};
    const V3 to_b = Cross(p0, e2);
    const V3 to_c = Cross(e1, p0);
    const V3 across = Cross(e2, e1);
    const V x = load(kRayX);
    const V y = load(kRayY);
    auto along_ray = [&](const V3& a) { return hn::MulAdd(x, a.x, hn::MulAdd(y, a.y, a.z)); };
    const V denominator = along_ray(across);
    const V inverse =
        hn::IfThenElseZero(hn::Gt(hn::Abs(denominator), hn::Set(d, 1e-20f)), hn::Div(one, denominator));
    const V exact_b = hn::Mul(along_ray(to_b), inverse);
    const V exact_c = hn::Mul(along_ray(to_c), inverse);
    const V inside_a = hn::Max(beside, hn::Sub(hn::Sub(one, exact_b), exact_c));
    const V inside_b = hn::Max(beside, exact_b);
    const V inside_c = hn::Max(beside, exact_c);
    const V sum = hn::Div(one, hn::Max(hn::Add(inside_a, hn::Add(inside_b, inside_c)), hn::Set(d, 1e-20f)));
    const V b = hn::Mul(inside_b, sum);
    const V c = hn::Mul(inside_c, sum);
    store(Blend3(p0.x, b, e1.x, c, e2.x), kX);
    store(Blend3(p0.y, b, e1.y, c, e2.y), kY);
    store(Blend3(p0.z, b, e1.z, c, e2.z), kZ);
    store(Blend3(v0.w, b, v1.w, c, v2.w), kU);
    store(b, kWeight1);
    store(c, kWeight2);

    const V4 n0 = LoadCorner(rows.corner(3) + 4 * i);
    const V4 n1 = Minus(LoadCorner(rows.corner(4) + 4 * i), n0);
    const V4 n2 = Minus(LoadCorner(rows.corner(5) + 4 * i), n0);
    const V side = hn::IfThenElse(hn::Lt(hn::Mul(denominator, load(kFront)), zero), hn::Neg(one), one);
    store(hn::Mul(side, Blend3(n0.x, b, n1.x, c, n2.x)), kNx);
    store(hn::Mul(side, Blend3(n0.y, b, n1.y, c, n2.y)), kNy);
    store(hn::Mul(side, Blend3(n0.z, b, n1.z, c, n2.z)), kNz);
    store(Blend3(n0.w, b, n1.w, c, n2.w), kV);

    const V step = hn::Mul(hn::Set(d, pixel_rad), inverse);
    const V db_x = hn::Mul(step, hn::NegMulAdd(exact_b, across.x, to_b.x));
    const V db_y = hn::Mul(step, hn::NegMulAdd(exact_b, across.y, to_b.y));
    const V dc_x = hn::Mul(step, hn::NegMulAdd(exact_c, across.x, to_c.x));
    const V dc_y = hn::Mul(step, hn::NegMulAdd(exact_c, across.y, to_c.y));
    const V du_x = hn::MulAdd(db_x, v1.w, hn::Mul(dc_x, v2.w));
    const V du_y = hn::MulAdd(db_y, v1.w, hn::Mul(dc_y, v2.w));
    const V dv_x = hn::MulAdd(db_x, n1.w, hn::Mul(dc_x, n2.w));
    const V dv_y = hn::MulAdd(db_y, n1.w, hn::Mul(dc_y, n2.w));
    const V width = load(kTextureWidth);
    const V height = load(kTextureHeight);
    const V right_u = hn::Mul(du_x, width);
    const V right_v = hn::Mul(dv_x, height);
    const V down_u = hn::Mul(du_y, width);
    const V down_v = hn::Mul(dv_y, height);
    const V right2 = hn::MulAdd(right_u, right_u, hn::Mul(right_v, right_v));
    const V down2 = hn::MulAdd(down_u, down_u, hn::Mul(down_v, down_v));
    const auto right_is_longer = hn::Ge(right2, down2);
    auto sane = [&](V v) { return hn::IfThenElseZero(hn::Le(hn::Abs(v), hn::Set(d, 16.0f)), v); };
    store(sane(hn::IfThenElse(right_is_longer, du_x, du_y)), kStepU);
    store(sane(hn::IfThenElse(right_is_longer, dv_x, dv_y)), kStepV);
    const V longer = hn::Sqrt(hn::Max(right2, down2));
    const V area = hn::Abs(hn::MulSub(right_u, down_v, hn::Mul(right_v, down_u)));
    const V shorter = hn::Div(area, hn::Max(longer, tiny));
    const V most = hn::IfThenElse(hn::Gt(longer, one), hn::Set(d, 4.0f), one);
    const V half = hn::Set(d, 0.5f);
    const V ratio = hn::Div(hn::Mul(half, longer), hn::Max(shorter, tiny));
    const V taps = hn::Min(hn::Max(hn::Ceil(hn::Sub(ratio, hn::Set(d, 0.01f))), one), most);
    store(taps, kTaps);
    store(hn::Max(hn::Sqrt(hn::Div(area, taps)), hn::Div(hn::Mul(half, longer), taps)), kTexelsPerTap);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(InterpolateVector);

void Interpolate(float pixel_rad, std::size_t count, FragmentRows& rows) {
  MIX_CHECK(count <= rows.capacity());
  HWY_DYNAMIC_DISPATCH(InterpolateVector)(pixel_rad, count, rows);
}

}  // namespace mixstage
#endif
