// SPDX-License-Identifier: Apache-2.0
//
// What rays meet of the figure: depth, normals, colour, coverage, and the time-of-flight phasor.
#include <algorithm>
#include <cmath>

#include "proto/synthetic/figure_kernels.h"
#include "proto/synthetic/room_plate.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "proto/synthetic/surface_kernels.cc"
#include <hwy/foreach_target.h>
// After foreach_target: once for every instruction set.
#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

#include "proto/synthetic/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage::HWY_NAMESPACE {
namespace {

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
  best = hn::IfThenElse(hn::And(hn::And(real, hn::Lt(t1, best)), hn::And(hn::Ge(z1, low), hn::Le(z1, high))),
                        t1, best);
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
  const auto k =
      Mul(Sub(w, hn::Set(d, part.slope * part.radius_a)), hn::Set(d, 1 / (1 - part.slope * part.slope)));
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

void RasterBodyImpl(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0,
                    const BodyTile& tile) {
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

void GatherBodyImpl(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0,
                    const BodyTile& tile) {
  const Pixels d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  for (float* plane : {tile.normal[0], tile.normal[1], tile.normal[2], tile.albedo[0], tile.albedo[1],
                       tile.albedo[2], tile.coverage}) {
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
        Surface<Pixels> sum{Load3(d, tile.normal, at), Load3(d, tile.albedo, at),
                            hn::LoadU(d, tile.coverage + at)};
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
HWY_ALIGN constexpr float kPlaceU[16] = {-0.46875f, -0.21875f, 0.03125f,  0.28125f,  -0.40625f, -0.15625f,
                                         0.09375f,  0.34375f,  -0.34375f, -0.09375f, 0.15625f,  0.40625f,
                                         -0.28125f, -0.03125f, 0.21875f,  0.46875f};
HWY_ALIGN constexpr float kPlaceV[16] = {-0.46875f, -0.34375f, -0.40625f, -0.28125f, -0.15625f, -0.03125f,
                                         -0.21875f, -0.09375f, 0.09375f,  0.21875f,  0.03125f,  0.15625f,
                                         0.28125f,  0.40625f,  0.34375f,  0.46875f};

void SupersampleBodyImpl(const PartView* parts, const std::uint8_t* list, int count, int u, int v, int index,
                         const float ray[3], const float ray_u[3], const float ray_v[3],
                         const BodyTile& tile) {
  const Pixels d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  std::uint8_t here[Figure::kMaxParts];
  int here_count = 0;
  for (int i = 0; i < count; ++i) {
    const PartView& part = parts[list[i]];
    if (u >= part.u0 && u <= part.u1 && v >= part.v0 && v <= part.v1) here[here_count++] = list[i];
  }
  Surface<Pixels> total{
      {hn::Zero(d), hn::Zero(d), hn::Zero(d)}, {hn::Zero(d), hn::Zero(d), hn::Zero(d)}, hn::Zero(d)};
  auto depth = hn::Zero(d);
  auto hits = hn::Zero(d);
  for (int first = 0; first < 16; first += lanes) {
    const auto pu = hn::Load(d, kPlaceU + first);
    const auto pv = hn::Load(d, kPlaceV + first);
    const Vec3<Pixels> r{
        MulAdd(pu, hn::Set(d, ray_u[0]), MulAdd(pv, hn::Set(d, ray_v[0]), hn::Set(d, ray[0]))),
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

int BodyPhasorImpl(const PartView* parts, const std::uint8_t* list, int count, const float* const rays[3],
                   const float* lengths, const float* room_re, const float* room_im, float radians_per_m,
                   float& re, float& im) {
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
    sum_re =
        Add(sum_re, hn::IfThenElse(hit, Mul(strength, hn::Cos(d, phase)), hn::LoadU(d, room_re + first)));
    sum_im =
        Add(sum_im, hn::IfThenElse(hit, Mul(strength, hn::Sin(d, phase)), hn::LoadU(d, room_im + first)));
    met += static_cast<int>(hn::CountTrue(d, hit));
  }
  re = hn::GetLane(hn::SumOfLanes(d, sum_re));
  im = hn::GetLane(hn::SumOfLanes(d, sum_im));
  return met;
}

}  // namespace
}  // namespace mixstage::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(RasterBodyImpl);
HWY_EXPORT(GatherBodyImpl);
HWY_EXPORT(SupersampleBodyImpl);
HWY_EXPORT(BodyPhasorImpl);

void RasterBody(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0,
                const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(RasterBodyImpl)(parts, list, count, u0, v0, tile);
}

void GatherBody(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0,
                const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(GatherBodyImpl)(parts, list, count, u0, v0, tile);
}

void SupersampleBody(const PartView* parts, const std::uint8_t* list, int count, int u, int v, int index,
                     const float ray[3], const float ray_u[3], const float ray_v[3], const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(SupersampleBodyImpl)(parts, list, count, u, v, index, ray, ray_u, ray_v, tile);
}

int BodyPhasor(const PartView* parts, const std::uint8_t* list, int count, const float* const rays[3],
               const float* lengths, const float* room_re, const float* room_im, float radians_per_m,
               float& re, float& im) {
  return HWY_DYNAMIC_DISPATCH(BodyPhasorImpl)(parts, list, count, rays, lengths, room_re, room_im,
                                              radians_per_m, re, im);
}

}  // namespace mixstage
#endif  // HWY_ONCE
