// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/figure_kernels.h"

#include <algorithm>
#include <cmath>

#include "proto/synthetic/room_plate.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "proto/synthetic/figure_kernels.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
#include <hwy/contrib/math/math-inl.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using hn::Add;
using hn::Div;
using hn::Max;
using hn::Min;
using hn::Mul;
using hn::MulAdd;
using hn::NegMulAdd;
using hn::Sqrt;
using hn::Sub;

template <class D>
struct Vec3 {
  hn::Vec<D> x, y, z;
};

template <class D, class V = hn::Vec<D>>
HWY_INLINE V Dot(D /*d*/, const Vec3<D>& a, const Vec3<D>& b) {
  return MulAdd(a.x, b.x, MulAdd(a.y, b.y, Mul(a.z, b.z)));
}
template <class D>
HWY_INLINE Vec3<D> Splat(D d, const float* v) {
  return {hn::Set(d, v[0]), hn::Set(d, v[1]), hn::Set(d, v[2])};
}
template <class D>
HWY_INLINE Vec3<D> Load3(D d, const float* const v[3], std::ptrdiff_t at) {
  return {hn::LoadU(d, v[0] + at), hn::LoadU(d, v[1] + at), hn::LoadU(d, v[2] + at)};
}
template <class D>
HWY_INLINE void Store3(D d, const Vec3<D>& v, float* const out[3], std::ptrdiff_t at) {
  hn::StoreU(v.x, d, out[0] + at);
  hn::StoreU(v.y, d, out[1] + at);
  hn::StoreU(v.z, d, out[2] + at);
}

// A ray in a part's own frame: origin at depth near_m, direction per metre of depth.
template <class D>
struct LocalRay {
  Vec3<D> o, d;
};

template <class D>
HWY_INLINE LocalRay<D> ToLocal(D d, const PartView& part, const Vec3<D>& ray) {
  LocalRay<D> local;
  const float* m = part.to_local;
  local.d.x = Dot(d, Splat(d, m), ray);
  local.d.y = Dot(d, Splat(d, m + 3), ray);
  local.d.z = Dot(d, Splat(d, m + 6), ray);
  const auto near = hn::Set(d, part.near_m);
  local.o.x = hn::MulSub(near, local.d.x, hn::Set(d, part.origin[0]));
  local.o.y = hn::MulSub(near, local.d.y, hn::Set(d, part.origin[1]));
  local.o.z = hn::MulSub(near, local.d.z, hn::Set(d, part.origin[2]));
  return local;
}

// RoundCone::Intersect for many rays; depth, kNoDepth where a ray misses.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V DepthOf(D d, const PartView& part, const LocalRay<D>& r) {
  const V none = hn::Set(d, kNoDepth);
  const V zero = hn::Zero(d);
  const V s = hn::Set(d, part.slope);
  const V cc = hn::Set(d, 1 - part.slope * part.slope);
  const V ra = hn::Set(d, part.radius_a);
  const V low = hn::Set(d, part.slope * part.radius_a);
  const V high = hn::Set(d, part.length + part.slope * part.radius_b);
  const V dxy = MulAdd(r.d.x, r.d.x, Mul(r.d.y, r.d.y));
  const V oxy = MulAdd(r.o.x, r.o.x, Mul(r.o.y, r.o.y));
  const V odxy = MulAdd(r.o.x, r.d.x, Mul(r.o.y, r.d.y));
  const V sdz = Mul(s, r.d.z);
  const V rim = NegMulAdd(s, r.o.z, ra);
  const V A = hn::MulSub(cc, dxy, Mul(sdz, sdz));
  const V B = MulAdd(cc, odxy, Mul(rim, sdz));
  const V C = hn::MulSub(cc, oxy, Mul(rim, rim));
  const V h = hn::MulSub(B, B, Mul(A, C));
  const V root = Sqrt(Max(h, zero));
  const V inverse = Div(hn::Set(d, 1.0f), A);
  const V t0 = Mul(hn::Neg(Add(B, root)), inverse);
  const V t1 = Mul(Sub(root, B), inverse);
  const V z0 = MulAdd(t0, r.d.z, r.o.z);
  const V z1 = MulAdd(t1, r.d.z, r.o.z);
  const auto real = hn::Ge(h, zero);
  V best = hn::IfThenElse(hn::And(real, hn::And(hn::Ge(z0, low), hn::Le(z0, high))), t0, none);
  best = hn::IfThenElse(hn::And(hn::And(real, hn::Lt(t1, best)), hn::And(hn::Ge(z1, low), hn::Le(z1, high))), t1, best);
  const V q = MulAdd(r.d.z, r.d.z, dxy);
  const V iq = Div(hn::Set(d, 1.0f), q);
  for (int end = 0; end < 2; ++end) {
    const V oz = end == 0 ? r.o.z : Sub(r.o.z, hn::Set(d, part.length));
    const V radius = hn::Set(d, end == 0 ? part.radius_a : part.radius_b);
    const V b = MulAdd(oz, r.d.z, odxy);
    const V c = Sub(MulAdd(oz, oz, oxy), Mul(radius, radius));
    const V hs = hn::MulSub(b, b, Mul(q, c));
    const V t = Mul(hn::Neg(Add(b, Sqrt(Max(hs, zero)))), iq);
    best = hn::IfThenElse(hn::And(hn::Ge(hs, zero), hn::Lt(t, best)), t, best);
  }
  const auto hit = hn::Lt(best, hn::Set(d, 1e8f));
  return hn::IfThenElse(hit, Add(best, hn::Set(d, part.near_m)), none);
}

// Outward normal in world axes, not yet of unit length one, at depth z.
template <class D>
HWY_INLINE Vec3<D> NormalOf(D d, const PartView& part, const LocalRay<D>& r, hn::Vec<D> z) {
  const auto t = Sub(z, hn::Set(d, part.near_m));
  const auto x = MulAdd(t, r.d.x, r.o.x);
  const auto y = MulAdd(t, r.d.y, r.o.y);
  auto w = MulAdd(t, r.d.z, r.o.z);
  const auto k = Mul(Sub(w, hn::Set(d, part.slope * part.radius_a)), hn::Set(d, 1 / (1 - part.slope * part.slope)));
  w = Sub(w, hn::Clamp(k, hn::Zero(d), hn::Set(d, part.length)));
  const float* m = part.to_local;
  Vec3<D> n{MulAdd(x, hn::Set(d, m[0]), MulAdd(y, hn::Set(d, m[3]), Mul(w, hn::Set(d, m[6])))),
            MulAdd(x, hn::Set(d, m[1]), MulAdd(y, hn::Set(d, m[4]), Mul(w, hn::Set(d, m[7])))),
            MulAdd(x, hn::Set(d, m[2]), MulAdd(y, hn::Set(d, m[5]), Mul(w, hn::Set(d, m[8]))))};
  const auto scale = Div(hn::Set(d, 1.0f), Sqrt(Max(Dot(d, n, n), hn::Set(d, 1e-12f))));
  return {Mul(n.x, scale), Mul(n.y, scale), Mul(n.z, scale)};
}

// How far behind the nearest surface a part still has a say in the normal and in the colour.
constexpr float kNormalFlow_m = 0.035f, kAlbedoFlow_m = 0.006f;

template <class D>
struct Surface {
  Vec3<D> normal, albedo;
  hn::Vec<D> weight;  // of albedo
};

template <class D>
HWY_INLINE void Blend(D d, const PartView& part, const LocalRay<D>& local, hn::Vec<D> z, hn::Vec<D> nearest,
                      Surface<D>& sum) {
  const auto one = hn::Set(d, 1.0f);
  const auto behind = Sub(z, nearest);
  auto wn = Max(NegMulAdd(behind, hn::Set(d, 1 / kNormalFlow_m), one), hn::Zero(d));
  wn = Mul(wn, wn);
  auto wa = Max(NegMulAdd(behind, hn::Set(d, 1 / kAlbedoFlow_m), one), hn::Zero(d));
  const auto n = NormalOf(d, part, local, z);
  // Far misses would make infinities of a weight of zero.
  const auto hit = hn::Lt(z, hn::Set(d, 1e8f));
  wn = hn::IfThenElseZero(hit, wn);
  wa = hn::IfThenElseZero(hit, wa);
  sum.normal.x = hn::IfThenElse(hit, MulAdd(wn, n.x, sum.normal.x), sum.normal.x);
  sum.normal.y = hn::IfThenElse(hit, MulAdd(wn, n.y, sum.normal.y), sum.normal.y);
  sum.normal.z = hn::IfThenElse(hit, MulAdd(wn, n.z, sum.normal.z), sum.normal.z);
  sum.albedo.x = MulAdd(wa, hn::Set(d, part.albedo[0]), sum.albedo.x);
  sum.albedo.y = MulAdd(wa, hn::Set(d, part.albedo[1]), sum.albedo.y);
  sum.albedo.z = MulAdd(wa, hn::Set(d, part.albedo[2]), sum.albedo.z);
  sum.weight = Add(sum.weight, wa);
}

// The part's rows and whole vectors of a tile.
struct Span {
  int row0, row1, col0, col1;
};
template <class D>
HWY_INLINE Span SpanOf(D d, const PartView& part, int u0, int v0) {
  const int lanes = static_cast<int>(hn::Lanes(d));
  return {std::max(part.v0 - v0, 0), std::min(part.v1 - v0, kTile - 1),
          std::max(part.u0 - u0, 0) / lanes * lanes, std::min(part.u1 - u0, kTile - 1)};
}

using Pixels = hn::CappedTag<float, 16>;

void RasterBodyImpl(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0, const BodyTile& tile) {
  const Pixels d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  std::fill(tile.z, tile.z + kTile * kTile, kNoDepth);
  for (int i = 0; i < count; ++i) {
    const PartView& part = parts[list[i]];
    const Span span = SpanOf(d, part, u0, v0);
    for (int row = span.row0; row <= span.row1; ++row) {
      for (int col = span.col0; col <= span.col1; col += lanes) {
        const auto local = ToLocal(d, part, Load3(d, tile.ray, row * kTile + col));
        float* z = tile.z + row * kTile + col;
        hn::StoreU(Min(hn::LoadU(d, z), DepthOf(d, part, local)), d, z);
      }
    }
  }
}

void GatherBodyImpl(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0, const BodyTile& tile) {
  const Pixels d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (float* plane : {tile.normal[0], tile.normal[1], tile.normal[2], tile.albedo[0], tile.albedo[1], tile.albedo[2],
                       tile.coverage}) {
    std::fill(plane, plane + kTile * kTile, 0.f);
  }
  // coverage holds the albedo's weight until the end.
  for (int i = 0; i < count; ++i) {
    const PartView& part = parts[list[i]];
    const Span span = SpanOf(d, part, u0, v0);
    for (int row = span.row0; row <= span.row1; ++row) {
      for (int col = span.col0; col <= span.col1; col += lanes) {
        const int at = row * kTile + col;
        const auto nearest = hn::LoadU(d, tile.z + at);
        if (hn::AllTrue(d, hn::Ge(nearest, hn::Set(d, 1e8f)))) continue;
        const auto local = ToLocal(d, part, Load3(d, tile.ray, row * kTile + col));
        const auto z = DepthOf(d, part, local);
        Surface<Pixels> sum{Load3(d, tile.normal, at), Load3(d, tile.albedo, at), hn::LoadU(d, tile.coverage + at)};
        Blend(d, part, local, z, nearest, sum);
        Store3(d, sum.normal, tile.normal, at);
        Store3(d, sum.albedo, tile.albedo, at);
        hn::StoreU(sum.weight, d, tile.coverage + at);
      }
    }
  }
  for (int at = 0; at < kTile * kTile; at += lanes) {
    const auto weight = hn::LoadU(d, tile.coverage + at);
    const auto inverse = Div(hn::Set(d, 1.0f), Max(weight, hn::Set(d, 1e-6f)));
    auto albedo = Load3(d, tile.albedo, at);
    albedo = {Mul(albedo.x, inverse), Mul(albedo.y, inverse), Mul(albedo.z, inverse)};
    Store3(d, albedo, tile.albedo, at);
    hn::StoreU(hn::IfThenElseZero(hn::Gt(weight, hn::Zero(d)), hn::Set(d, 1.0f)), d, tile.coverage + at);
  }
}

// 16 places of a pixel, one in each cell of a 4 x 4 grid, no two in a row or column of 16.
HWY_ALIGN constexpr float kPlaceU[16] = {-0.46875f, -0.21875f, 0.03125f, 0.28125f, -0.40625f, -0.15625f,
                                         0.09375f,  0.34375f,  -0.34375f, -0.09375f, 0.15625f, 0.40625f,
                                         -0.28125f, -0.03125f, 0.21875f,  0.46875f};
HWY_ALIGN constexpr float kPlaceV[16] = {-0.46875f, -0.34375f, -0.40625f, -0.28125f, -0.15625f, -0.03125f,
                                         -0.21875f, -0.09375f, 0.09375f,  0.21875f,  0.03125f, 0.15625f,
                                         0.28125f,  0.40625f,  0.34375f,  0.46875f};

void SupersampleBodyImpl(const PartView* parts, const std::uint8_t* list, int count, int u, int v, int index,
                         const float ray[3], const float ray_u[3], const float ray_v[3], const BodyTile& tile) {
  const Pixels d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  std::uint8_t here[Figure::kMaxParts];
  int here_count = 0;
  for (int i = 0; i < count; ++i) {
    const PartView& part = parts[list[i]];
    if (u >= part.u0 && u <= part.u1 && v >= part.v0 && v <= part.v1) here[here_count++] = list[i];
  }
  Surface<Pixels> total{{hn::Zero(d), hn::Zero(d), hn::Zero(d)}, {hn::Zero(d), hn::Zero(d), hn::Zero(d)}, hn::Zero(d)};
  auto depth = hn::Zero(d);
  auto hits = hn::Zero(d);
  for (int first = 0; first < 16; first += lanes) {
    const auto pu = hn::Load(d, kPlaceU + first);
    const auto pv = hn::Load(d, kPlaceV + first);
    const Vec3<Pixels> r{MulAdd(pu, hn::Set(d, ray_u[0]), MulAdd(pv, hn::Set(d, ray_v[0]), hn::Set(d, ray[0]))),
                         MulAdd(pu, hn::Set(d, ray_u[1]), MulAdd(pv, hn::Set(d, ray_v[1]), hn::Set(d, ray[1]))),
                         MulAdd(pu, hn::Set(d, ray_u[2]), MulAdd(pv, hn::Set(d, ray_v[2]), hn::Set(d, ray[2])))};
    auto nearest = hn::Set(d, kNoDepth);
    for (int i = 0; i < here_count; ++i) {
      const PartView& part = parts[here[i]];
      nearest = Min(nearest, DepthOf(d, part, ToLocal(d, part, r)));
    }
    const auto hit = hn::Lt(nearest, hn::Set(d, 1e8f));
    if (hn::AllFalse(d, hit)) continue;
    hits = Add(hits, hn::IfThenElseZero(hit, hn::Set(d, 1.0f)));
    depth = Add(depth, hn::IfThenElseZero(hit, nearest));
    for (int i = 0; i < here_count; ++i) {
      const PartView& part = parts[here[i]];
      const auto local = ToLocal(d, part, r);
      Blend(d, part, local, DepthOf(d, part, local), nearest, total);
    }
  }
  auto sum = [&](hn::Vec<Pixels> x) { return hn::GetLane(hn::SumOfLanes(d, x)); };
  const float n = sum(hits);
  tile.coverage[index] = n / 16;
  if (n <= 0) {
    tile.z[index] = kNoDepth;
    return;
  }
  const float scale = 1 / std::max(sum(total.weight), 1e-6f);
  tile.z[index] = sum(depth) / n;
  tile.normal[0][index] = sum(total.normal.x);
  tile.normal[1][index] = sum(total.normal.y);
  tile.normal[2][index] = sum(total.normal.z);
  tile.albedo[0][index] = scale * sum(total.albedo.x);
  tile.albedo[1][index] = scale * sum(total.albedo.y);
  tile.albedo[2][index] = scale * sum(total.albedo.z);
}

// The share of the lamp's light that all casters together leave.
template <class D>
HWY_INLINE hn::Vec<D> LampShare(D d, const SoftLamp& lamp, const Caster* casters, int count, float Caster::* radius_of,
                                float from_m, const Vec3<D>& p) {
  using V = hn::Vec<D>;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0f);
  Vec3<D> l{Sub(hn::Set(d, lamp.center[0]), p.x), Sub(hn::Set(d, lamp.center[1]), p.y),
            Sub(hn::Set(d, lamp.center[2]), p.z)};
  const V T = Sqrt(Max(Dot(d, l, l), hn::Set(d, 1e-6f)));
  const V inverse = Div(one, T);
  l = {Mul(l.x, inverse), Mul(l.y, inverse), Mul(l.z, inverse)};
  const V spread = Mul(hn::Set(d, lamp.radius), inverse);
  V share = one;
  for (int i = 0; i < count; ++i) {
    const Caster& c = casters[i];
    const Vec3<D> ab = Splat(d, c.ab);
    const Vec3<D> w{Sub(p.x, hn::Set(d, c.a[0])), Sub(p.y, hn::Set(d, c.a[1])), Sub(p.z, hn::Set(d, c.a[2]))};
    const V B = Dot(d, l, ab);
    const V D_ = Dot(d, l, w);
    const V E = Dot(d, ab, w);
    const V den = Max(NegMulAdd(B, B, hn::Set(d, c.length2)), hn::Set(d, 1e-6f));
    const V s = hn::Clamp(Mul(NegMulAdd(B, D_, E), hn::ApproximateReciprocal(den)), zero, one);
    const V t = hn::Clamp(hn::MulSub(s, B, D_), hn::Set(d, from_m), T);
    const Vec3<D> off{NegMulAdd(s, ab.x, MulAdd(t, l.x, w.x)), NegMulAdd(s, ab.y, MulAdd(t, l.y, w.y)),
                      NegMulAdd(s, ab.z, MulAdd(t, l.z, w.z))};
    const V distance2 = Max(Dot(d, off, off), hn::Set(d, 1e-12f));
    const V distance = Mul(distance2, hn::ApproximateReciprocalSqrt(distance2));
    const V reach = MulAdd(t, spread, hn::Set(d, 1e-3f));
    const V r = hn::Set(d, c.*radius_of);
    const V covered = Sub(Min(Add(distance, r), reach), Max(Sub(distance, r), hn::Neg(reach)));
    const V hidden = hn::Clamp(Mul(covered, hn::ApproximateReciprocal(Add(reach, reach))), zero, one);
    share = NegMulAdd(share, hidden, share);
  }
  return share;
}

template <class D>
HWY_INLINE hn::Vec<D> AmbientShare(D d, const Caster* casters, int count, float Caster::* radius_of, const Vec3<D>& p,
                                   const Vec3<D>& n) {
  using V = hn::Vec<D>;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0f);
  V share = one;
  for (int i = 0; i < count; ++i) {
    const Caster& c = casters[i];
    const Vec3<D> ab = Splat(d, c.ab);
    const Vec3<D> w{Sub(p.x, hn::Set(d, c.a[0])), Sub(p.y, hn::Set(d, c.a[1])), Sub(p.z, hn::Set(d, c.a[2]))};
    const V s = hn::Clamp(Mul(Dot(d, ab, w), hn::Set(d, 1 / std::max(c.length2, 1e-6f))), zero, one);
    const Vec3<D> v{hn::MulSub(s, ab.x, w.x), hn::MulSub(s, ab.y, w.y), hn::MulSub(s, ab.z, w.z)};
    const V d2 = Max(Dot(d, v, v), hn::Set(d, 1e-6f));
    const V r = hn::Set(d, c.*radius_of);
    const V inverse = hn::ApproximateReciprocalSqrt(d2);
    const V cosine = Max(Mul(Dot(d, n, v), inverse), zero);
    const V hidden = Mul(cosine, Min(Mul(Mul(r, r), Mul(inverse, inverse)), one));
    share = NegMulAdd(share, hidden, share);
  }
  return share;
}

void OccludeRoomImpl(const BodyLight& light, const Caster* casters, int count, const PointSpan& points) {
  const Pixels d;
  for (int i = 0; i < points.count; i += static_cast<int>(hn::Lanes(d))) {
    const Vec3<Pixels> p = Load3(d, points.p, i);
    const Vec3<Pixels> n = Load3(d, points.n, i);
    hn::StoreU(LampShare(d, light.window_lamp, casters, count, &Caster::room_radius, 0.0f, p), d, points.window + i);
    hn::StoreU(LampShare(d, light.softbox_lamp, casters, count, &Caster::room_radius, 0.0f, p), d, points.softbox + i);
    hn::StoreU(AmbientShare(d, casters, count, &Caster::room_radius, p, n), d, points.ambient + i);
  }
}

template <class D>
HWY_INLINE hn::Vec<D> FromPoint(D d, const BodyLight::Point& light, const Vec3<D>& p, const Vec3<D>& n) {
  const Vec3<D> l{Sub(hn::Set(d, light.position[0]), p.x), Sub(hn::Set(d, light.position[1]), p.y),
                  Sub(hn::Set(d, light.position[2]), p.z)};
  const auto r2 = Max(Dot(d, l, l), hn::Set(d, 1e-4f));
  const auto at_body = Max(Dot(d, n, l), hn::Zero(d));
  const auto at_lamp = Max(hn::Neg(Dot(d, Splat(d, light.normal), l)), hn::Zero(d));
  const auto inverse = hn::ApproximateReciprocal(r2);
  return Mul(Mul(at_body, at_lamp), Mul(inverse, inverse));
}

void ShadeBodyImpl(const BodyLight& light, const Caster* casters, int caster_count, const Eigen::Vector3f& camera,
                   const BodyTile& tile) {
  const Pixels d;
  using V = hn::Vec<Pixels>;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0f);
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (int row = 0; row < kTile; ++row) {
    for (int col = 0; col < kTile; col += lanes) {
      const int at = row * kTile + col;
      const V coverage = hn::LoadU(d, tile.coverage + at);
      if (hn::AllFalse(d, hn::Gt(coverage, zero))) continue;
      const V z = Min(hn::LoadU(d, tile.z + at), hn::Set(d, 100.0f));
      const Vec3<Pixels> ray = Load3(d, tile.ray, row * kTile + col);
      const Vec3<Pixels> p{MulAdd(z, ray.x, hn::Set(d, camera[0])), MulAdd(z, ray.y, hn::Set(d, camera[1])),
                           MulAdd(z, ray.z, hn::Set(d, camera[2]))};
      Vec3<Pixels> n = Load3(d, tile.normal, at);
      const V scale = Div(one, Sqrt(Max(Dot(d, n, n), hn::Set(d, 1e-12f))));
      n = {Mul(n.x, scale), Mul(n.y, scale), Mul(n.z, scale)};
      const Vec3<Pixels> above{MulAdd(n.x, hn::Set(d, 0.015f), p.x), MulAdd(n.y, hn::Set(d, 0.015f), p.y),
                               MulAdd(n.z, hn::Set(d, 0.015f), p.z)};
      const V window = LampShare(d, light.window_lamp, casters, caster_count, &Caster::body_radius, 0.05f, above);
      const V softbox = LampShare(d, light.softbox_lamp, casters, caster_count, &Caster::body_radius, 0.05f, above);
      V around = AmbientShare(d, casters, caster_count, &Caster::body_radius, above, n);
      // Cloth seen at a grazing angle catches light on its fibres.
      const V away = Dot(d, n, ray);
      const V facing = Mul(Max(hn::Neg(away), zero), Div(one, Sqrt(Dot(d, ray, ray))));
      const V edge = Sub(one, Min(facing, one));
      around = MulAdd(Mul(around, Mul(edge, edge)), Mul(edge, hn::Set(d, 0.35f)), around);
      V e[3] = {zero, zero, zero};
      for (int i = 0; i < kLampPoints; ++i) {
        const V w = Mul(window, FromPoint(d, light.window[i], p, n));
        const V s = Mul(softbox, FromPoint(d, light.softbox[i], p, n));
        for (int c = 0; c < 3; ++c) {
          e[c] = MulAdd(w, hn::Set(d, light.window[i].power[c]), e[c]);
          e[c] = MulAdd(s, hn::Set(d, light.softbox[i].power[c]), e[c]);
        }
      }
      const V high = hn::Clamp(Mul(Sub(p.z, hn::Set(d, light.ambient_z[0])),
                                   hn::Set(d, 1 / (light.ambient_z[1] - light.ambient_z[0]))),
                               zero, one);
      const V squares[6] = {Mul(Max(n.x, zero), n.x), Mul(Min(n.x, zero), n.x), Mul(Max(n.y, zero), n.y),
                            Mul(Min(n.y, zero), n.y), Mul(Max(n.z, zero), n.z), Mul(Min(n.z, zero), n.z)};
      const V shading = hn::LoadU(d, tile.vignette + row * kTile + col);
      for (int c = 0; c < 3; ++c) {
        V ambient = zero;
        for (int f = 0; f < 6; ++f) {
          const V lo = hn::Set(d, light.ambient[0][f][c]);
          const V hi = hn::Set(d, light.ambient[1][f][c]);
          ambient = MulAdd(squares[f], MulAdd(high, Sub(hi, lo), lo), ambient);
        }
        const V total = MulAdd(around, ambient, e[c]);
        hn::StoreU(Mul(shading, Mul(total, hn::LoadU(d, tile.albedo[c] + at))), d, tile.color[c] + at);
      }
    }
  }
}

// CameraResponse for many: the sRGB curve by three square roots (within 0.1 % of it above 0.01).
template <class D, class V = hn::Vec<D>>
HWY_INLINE V Response(D d, V x) {
  const V knee = hn::Set(d, 0.7f);
  const V over = Max(Sub(x, knee), hn::Zero(d));
  const V bent =
      MulAdd(over, hn::ApproximateReciprocal(MulAdd(over, hn::Set(d, 1 / 0.32f), hn::Set(d, 1.0f))), knee);
  x = hn::IfThenElse(hn::Gt(x, knee), bent, x);
  x = hn::Clamp(x, hn::Set(d, 1e-6f), hn::Set(d, 1.0f));
  // Roots as x / sqrt(x): 12 good bits are a thirtieth of a count.
  const V s1 = Mul(x, hn::ApproximateReciprocalSqrt(x));
  const V s2 = Mul(s1, hn::ApproximateReciprocalSqrt(s1));
  const V s3 = Mul(s2, hn::ApproximateReciprocalSqrt(s2));
  const V curve = MulAdd(s1, hn::Set(d, 0.662002687f),
                         MulAdd(s2, hn::Set(d, 0.684122060f),
                                NegMulAdd(s3, hn::Set(d, 0.323583601f), Mul(x, hn::Set(d, -0.0225411470f)))));
  return hn::IfThenElse(hn::Lt(x, hn::Set(d, 0.0031308f)), Mul(x, hn::Set(d, 12.92f)), curve);
}

// Shares at the pixels of a tile, between its nodes. In a pass of its own: vectors loaded right after narrow stores
// would wait for them.
void SpreadShares(const ComposeTile& tile, float (*share)[kTile * kTile]) {
  for (int k = 0; k < 3; ++k) {
    if (tile.share[k] == nullptr) {
      std::fill(share[k], share[k] + kTile * kTile, 1.f);
      continue;
    }
    for (int row = 0; row < kTile; ++row) {
      const float down = static_cast<float>(row % kNodeStep) / kNodeStep;
      const float* upper = tile.share[k] + row / kNodeStep * kShareStride;
      const float* lower = upper + kShareStride;
      float left = upper[0] + down * (lower[0] - upper[0]);
      for (int i = 0; i < kTile / kNodeStep; ++i) {
        const float right = upper[i + 1] + down * (lower[i + 1] - upper[i + 1]);
        const float step = (right - left) / kNodeStep;
        for (int j = 0; j < kNodeStep; ++j) {
          share[k][row * kTile + kNodeStep * i + j] = left + static_cast<float>(j) * step;
        }
        left = right;
      }
    }
  }
}

void ComposeImpl(const ComposeTile& tile) {
  const Pixels d;
  using V = hn::Vec<Pixels>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  HWY_ALIGN float share[3][kTile * kTile];
  HWY_ALIGN float cb[2][kTile];
  HWY_ALIGN float cr[2][kTile];
  SpreadShares(tile, share);
  for (int row = 0; row < kTile; ++row) {
    for (int col = 0; col < kTile; col += lanes) {
      const V unit = hn::Set(d, 1 / kLayerScale);
      const V share_of[3] = {Mul(unit, hn::Load(d, share[0] + row * kTile + col)),
                             Mul(unit, hn::Load(d, share[1] + row * kTile + col)),
                             Mul(unit, hn::Load(d, share[2] + row * kTile + col))};
      V rgb[3];
      for (int c = 0; c < 3; ++c) {
        V light = hn::Zero(d);
        for (int k = 0; k < 3; ++k) {
          const auto counts = hn::LoadU(hn::Rebind<std::uint16_t, Pixels>(),
                                        tile.layer[k] + (c * kTile + row) * kTile + col);
          light = MulAdd(share_of[k], hn::ConvertTo(d, hn::PromoteTo(hn::RebindToSigned<Pixels>(), counts)), light);
        }
        if (tile.coverage != nullptr) {
          const V alpha = hn::LoadU(d, tile.coverage + row * kTile + col);
          const V body = hn::LoadU(d, tile.color[c] + row * kTile + col);
          light = MulAdd(alpha, Sub(body, light), light);
        }
        rgb[c] = Response(d, light);
      }
      const V y = MulAdd(rgb[0], hn::Set(d, 0.299f), MulAdd(rgb[1], hn::Set(d, 0.587f), Mul(rgb[2], hn::Set(d, 0.114f))));
      hn::StoreU(Mul(Sub(rgb[2], y), hn::Set(d, 0.564334f)), d, cb[row & 1] + col);
      hn::StoreU(Mul(Sub(rgb[0], y), hn::Set(d, 0.713267f)), d, cr[row & 1] + col);
      const auto whole = hn::NearestInt(Mul(y, hn::Set(d, 255.0f * 64)));
      hn::StoreU(hn::DemoteTo(hn::Rebind<std::int16_t, Pixels>(), whole), hn::Rebind<std::int16_t, Pixels>(),
                 tile.y + row * tile.y_stride + col);
    }
    if ((row & 1) == 0) continue;
    for (int i = 0; i < kTile / 2; ++i) {  // 4:2:0 sits in the middle of four
      const float b = cb[0][2 * i] + cb[0][2 * i + 1] + cb[1][2 * i] + cb[1][2 * i + 1];
      const float r = cr[0][2 * i] + cr[0][2 * i + 1] + cr[1][2 * i] + cr[1][2 * i + 1];
      const std::ptrdiff_t at = row / 2 * tile.chroma_stride + i;
      tile.cb[at] = static_cast<std::int16_t>(b * (255.f * 16) + (128.f * 64 + 0.5f));
      tile.cr[at] = static_cast<std::int16_t>(r * (255.f * 16) + (128.f * 64 + 0.5f));
    }
  }
}

int BodyPhasorImpl(const PartView* parts, const std::uint8_t* list, int count, const float* const rays[3],
                   const float* lengths, const float* room_re, const float* room_im, float radians_per_m, float& re,
                   float& im) {
  using D = hn::CappedTag<float, 8>;
  const D d;
  using V = hn::Vec<D>;
  const int lanes = static_cast<int>(hn::Lanes(d));
  V sum_re = hn::Zero(d);
  V sum_im = hn::Zero(d);
  int met = 0;
  for (int first = 0; first < 8; first += lanes) {
    const Vec3<D> ray = Load3(d, rays, first);
    const V length = hn::LoadU(d, lengths + first);
    V nearest = hn::Set(d, kNoDepth);
    V amplitude = hn::Zero(d);
    for (int i = 0; i < count; ++i) {
      const PartView& part = parts[list[i]];
      const auto local = ToLocal(d, part, ray);
      const V z = DepthOf(d, part, local);
      const auto nearer = hn::Lt(z, nearest);
      if (hn::AllFalse(d, nearer)) continue;
      const auto n = NormalOf(d, part, local, z);
      const V cosine = Div(Max(hn::Neg(Dot(d, n, ray)), hn::Zero(d)), length);
      amplitude = hn::IfThenElse(nearer, Mul(cosine, hn::Set(d, part.infrared)), amplitude);
      nearest = Min(nearest, z);
    }
    const auto hit = hn::Lt(nearest, hn::Set(d, 1e8f));
    const V range = hn::IfThenElse(hit, Mul(nearest, length), hn::Set(d, 1.0f));
    const V strength = Div(amplitude, Mul(range, range));
    const V phase = Mul(range, hn::Set(d, radians_per_m));
    sum_re = Add(sum_re, hn::IfThenElse(hit, Mul(strength, hn::Cos(d, phase)), hn::LoadU(d, room_re + first)));
    sum_im = Add(sum_im, hn::IfThenElse(hit, Mul(strength, hn::Sin(d, phase)), hn::LoadU(d, room_im + first)));
    met += static_cast<int>(hn::CountTrue(d, hit));
  }
  re = hn::GetLane(hn::SumOfLanes(d, sum_re));
  im = hn::GetLane(hn::SumOfLanes(d, sum_im));
  return met;
}

void AddNoiseImpl(const std::int16_t* base, const std::int8_t* noise, int count, int gain, int slope,
                  std::uint8_t* out) {
  using D = hn::CappedTag<std::int16_t, 16>;
  const D d;
  const hn::Rebind<std::int8_t, D> d8;
  const hn::Rebind<std::uint8_t, D> du8;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto base_gain = hn::Set(d, static_cast<std::int16_t>(gain));
  const auto half = hn::Set(d, std::int16_t{32});
  const auto by_slope = hn::Set(d, static_cast<std::int16_t>(slope));
  int i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto value = hn::LoadU(d, base + i);
    const auto n = hn::PromoteTo(d, hn::LoadU(d8, noise + i));
    const auto g = Sub(base_gain, Mul(by_slope, hn::ShiftRight<9>(value)));
    const auto sum = hn::SaturatedAdd(hn::SaturatedAdd(value, hn::ShiftRight<4>(Mul(n, g))), half);
    hn::StoreU(hn::DemoteTo(du8, hn::ShiftRight<6>(sum)), du8, out + i);
  }
  AddNoiseScalar(base + i, noise + i, count - i, gain, slope, out + i);
}

}  // namespace
}  // namespace mixstage::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(RasterBodyImpl);
HWY_EXPORT(GatherBodyImpl);
HWY_EXPORT(SupersampleBodyImpl);
HWY_EXPORT(ShadeBodyImpl);
HWY_EXPORT(OccludeRoomImpl);
HWY_EXPORT(ComposeImpl);
HWY_EXPORT(BodyPhasorImpl);
HWY_EXPORT(AddNoiseImpl);

void RasterBody(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0, const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(RasterBodyImpl)(parts, list, count, u0, v0, tile);
}
void GatherBody(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0, const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(GatherBodyImpl)(parts, list, count, u0, v0, tile);
}
void SupersampleBody(const PartView* parts, const std::uint8_t* list, int count, int u, int v, int index,
                     const float ray[3], const float ray_u[3], const float ray_v[3], const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(SupersampleBodyImpl)(parts, list, count, u, v, index, ray, ray_u, ray_v, tile);
}
void ShadeBody(const BodyLight& light, const Caster* casters, int caster_count, const Eigen::Vector3f& camera,
               const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(ShadeBodyImpl)(light, casters, caster_count, camera, tile);
}
void OccludeRoom(const BodyLight& light, const Caster* casters, int caster_count, const PointSpan& points) {
  HWY_DYNAMIC_DISPATCH(OccludeRoomImpl)(light, casters, caster_count, points);
}
void Compose(const ComposeTile& tile) { HWY_DYNAMIC_DISPATCH(ComposeImpl)(tile); }
int BodyPhasor(const PartView* parts, const std::uint8_t* list, int count, const float* const rays[3],
               const float* lengths, const float* room_re, const float* room_im, float radians_per_m, float& re,
               float& im) {
  return HWY_DYNAMIC_DISPATCH(BodyPhasorImpl)(parts, list, count, rays, lengths, room_re, room_im, radians_per_m, re,
                                              im);
}
void AddNoise(const std::int16_t* base, const std::int8_t* noise, int count, int gain, int slope, std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(AddNoiseImpl)(base, noise, count, gain, slope, out);
}

}  // namespace mixstage
#endif  // HWY_ONCE
