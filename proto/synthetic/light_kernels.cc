// SPDX-License-Identifier: Apache-2.0
//
// Light and shadow of the figure and of the room around him, and the pictures made of them.
#include <algorithm>
#include <cmath>

#include "proto/synthetic/figure_kernels.h"
#include "proto/synthetic/room_plate.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "proto/synthetic/light_kernels.cc"
#include <hwy/foreach_target.h>
// After foreach_target: once for every instruction set.
#include <hwy/highway.h>

#include "proto/synthetic/vectors-inl.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage::HWY_NAMESPACE {
namespace {

// The share of the lamp's light that all casters together leave.
template <class D>
HWY_INLINE hn::Vec<D> LampShare(D d, const SoftLamp& lamp, const Caster* casters, int count,
                                float Caster::*radius_of, float from_m, const Vec3<D>& p) {
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
HWY_INLINE hn::Vec<D> AmbientShare(D d, const Caster* casters, int count, float Caster::*radius_of,
                                   const Vec3<D>& p, const Vec3<D>& n) {
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
    hn::StoreU(LampShare(d, light.window_lamp, casters, count, &Caster::room_radius, 0.0f, p), d,
               points.window + i);
    hn::StoreU(LampShare(d, light.softbox_lamp, casters, count, &Caster::room_radius, 0.0f, p), d,
               points.softbox + i);
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

void ShadeBodyImpl(const BodyLight& light, const Caster* casters, int caster_count,
                   const Eigen::Vector3f& camera, const BodyTile& tile) {
  const Pixels d;
  using V = hn::Vec<Pixels>;
  const V zero = hn::Zero(d);
  const V one = hn::Set(d, 1.0f);
  const int lanes = static_cast<int>(hn::Lanes(d));
  struct {
    HWY_ALIGN float z[kTile], window[kTile], softbox[kTile], ambient[kTile];
  } shares;
  std::fill(shares.z, shares.z + kTile, kNoDepth);
  for (int row = 0; row < kTile; ++row) {
    for (int col = 0; col < kTile; col += lanes) {
      const int at = row * kTile + col;
      const V coverage = hn::LoadU(d, tile.coverage + at);
      if (hn::AllFalse(d, hn::Gt(coverage, zero))) {
        hn::Store(hn::Set(d, kNoDepth), d, shares.z + col);
        continue;
      }
      const V z = Min(hn::LoadU(d, tile.z + at), hn::Set(d, 100.0f));
      const Vec3<Pixels> ray = Load3(d, tile.ray, row * kTile + col);
      const Vec3<Pixels> p{MulAdd(z, ray.x, hn::Set(d, camera[0])), MulAdd(z, ray.y, hn::Set(d, camera[1])),
                           MulAdd(z, ray.z, hn::Set(d, camera[2]))};
      Vec3<Pixels> n = Load3(d, tile.normal, at);
      const V scale = Div(one, Sqrt(Max(Dot(d, n, n), hn::Set(d, 1e-12f))));
      n = {Mul(n.x, scale), Mul(n.y, scale), Mul(n.z, scale)};
      const Vec3<Pixels> above{MulAdd(n.x, hn::Set(d, 0.015f), p.x), MulAdd(n.y, hn::Set(d, 0.015f), p.y),
                               MulAdd(n.z, hn::Set(d, 0.015f), p.z)};
      // Shadows on the body are soft: a pixel takes them over from the one above when that is on the same
      // surface.
      const V z_above = hn::Load(d, shares.z + col);
      const auto near = hn::Lt(hn::Abs(Sub(z, z_above)), hn::Set(d, 0.02f));
      const auto covered = hn::Gt(coverage, zero);
      if (row % 2 == 0 || !hn::AllTrue(d, hn::Or(near, hn::Not(covered)))) {
        hn::Store(LampShare(d, light.window_lamp, casters, caster_count, &Caster::body_radius, 0.05f, above),
                  d, shares.window + col);
        hn::Store(LampShare(d, light.softbox_lamp, casters, caster_count, &Caster::body_radius, 0.05f, above),
                  d, shares.softbox + col);
        hn::Store(AmbientShare(d, casters, caster_count, &Caster::body_radius, above, n), d,
                  shares.ambient + col);
      }
      hn::Store(z, d, shares.z + col);
      const V window = hn::Load(d, shares.window + col);
      const V softbox = hn::Load(d, shares.softbox + col);
      V around = hn::Load(d, shares.ambient + col);
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

// Shares at the pixels of a tile, between its nodes. In a pass of its own: vectors loaded right after narrow
// stores would wait for them.
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
          const auto counts =
              hn::LoadU(hn::Rebind<std::uint16_t, Pixels>(), tile.layer[k] + (c * kTile + row) * kTile + col);
          light = MulAdd(share_of[k], hn::ConvertTo(d, hn::PromoteTo(hn::RebindToSigned<Pixels>(), counts)),
                         light);
        }
        if (tile.coverage != nullptr) {
          const V alpha = hn::LoadU(d, tile.coverage + row * kTile + col);
          const V body = hn::LoadU(d, tile.color[c] + row * kTile + col);
          light = MulAdd(alpha, Sub(body, light), light);
        }
        rgb[c] = Response(d, light);
      }
      const V y = MulAdd(rgb[0], hn::Set(d, 0.299f),
                         MulAdd(rgb[1], hn::Set(d, 0.587f), Mul(rgb[2], hn::Set(d, 0.114f))));
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

HWY_EXPORT(ShadeBodyImpl);
HWY_EXPORT(OccludeRoomImpl);
HWY_EXPORT(ComposeImpl);
HWY_EXPORT(AddNoiseImpl);

void ShadeBody(const BodyLight& light, const Caster* casters, int caster_count, const Eigen::Vector3f& camera,
               const BodyTile& tile) {
  HWY_DYNAMIC_DISPATCH(ShadeBodyImpl)(light, casters, caster_count, camera, tile);
}

void OccludeRoom(const BodyLight& light, const Caster* casters, int caster_count, const PointSpan& points) {
  HWY_DYNAMIC_DISPATCH(OccludeRoomImpl)(light, casters, caster_count, points);
}

void Compose(const ComposeTile& tile) { HWY_DYNAMIC_DISPATCH(ComposeImpl)(tile); }

void AddNoise(const std::int16_t* base, const std::int8_t* noise, int count, int gain, int slope,
              std::uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(AddNoiseImpl)(base, noise, count, gain, slope, out);
}

}  // namespace mixstage
#endif  // HWY_ONCE
