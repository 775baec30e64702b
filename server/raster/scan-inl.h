// SPDX-License-Identifier: Apache-2.0
//
// What the vector scan kernels share, compiled once per instruction set: edge functions and planes of 1/z for
// several triangles at once. Include after hwy/highway.h, inside no namespace.
//
// Exactness: corners are integers in 1/256 px. An edge function at pixel (i, j) is c + 256 (dx j - dy i) with
// integer c, so its sign is that of floor(c / 256) + dx j - dy i: integers below 2^24 for edges of at most 60
// px, which a float holds exactly. Multiplications and additions of 1/z are kept apart (no fused ones), so
// that every instruction set and the scalar code give the same bits.
#if defined(MIXSTAGE_SERVER_RASTER_SCAN_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef MIXSTAGE_SERVER_RASTER_SCAN_INL_H_
#undef MIXSTAGE_SERVER_RASTER_SCAN_INL_H_
#else
#define MIXSTAGE_SERVER_RASTER_SCAN_INL_H_
#endif

#include <hwy/highway.h>

#include "server/raster/projected_vertex.h"
#include "server/raster/raster_lens.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage::raster::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Eight lanes are one row of a small triangle; wider vectors would idle.
using DF = hn::CappedTag<float, 8>;
using DI = hn::RebindToSigned<DF>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;
using MI = hn::Mask<DI>;
constexpr std::size_t kMaxLanes = 8;

// Floor(c / 256) with the top-left rule in it, and what one pixel to the right and down adds.
struct EdgeLanes {
  VF c, right, down;
};
HWY_INLINE EdgeLanes SetUpEdge(VI ax, VI ay, VI bx, VI by) {
  const DI di;
  const DF df;
  const VI dx = hn::Sub(bx, ax);
  const VI dy = hn::Sub(by, ay);
  const VI zero = hn::Zero(di);
  const MI top_left = hn::Or(hn::Lt(dy, zero), hn::And(hn::Eq(dy, zero), hn::Gt(dx, zero)));
  const VI c =
      hn::Sub(hn::Sub(hn::Mul(dy, ax), hn::Mul(dx, ay)), hn::IfThenZeroElse(top_left, hn::Set(di, 1)));
  return {hn::ConvertTo(df, hn::ShiftRight<kSubPixelBits>(c)), hn::ConvertTo(df, hn::Neg(dy)),
          hn::ConvertTo(df, dx)};
}

// Twice the area in sub-pixels squared; > 0 where a, b, c run clockwise on the screen (y down).
HWY_INLINE VI TwiceArea(VI ax, VI ay, VI bx, VI by, VI cx, VI cy) {
  return hn::Sub(hn::Mul(hn::Sub(bx, ax), hn::Sub(cy, ay)), hn::Mul(hn::Sub(by, ay), hn::Sub(cx, ax)));
}

struct PlaneLanes {
  VF c, right, down;
};
// 1/z over the triangle; corners relative to the pixel where c holds. Slivers thinner than 1/64 px have no
// meaningful gradient in single precision: they are flat.
HWY_INLINE PlaneLanes SetUpPlane(VI ax, VI ay, VF az, VI bx, VI by, VF bz, VI cx, VI cy, VF cz,
                                 VI twice_area) {
  const DI di;
  const DF df;
  const VI x1 = hn::Sub(bx, ax);
  const VI y1 = hn::Sub(by, ay);
  const VI x2 = hn::Sub(cx, ax);
  const VI y2 = hn::Sub(cy, ay);
  const VF z1 = hn::Sub(bz, az);
  const VF z2 = hn::Sub(cz, az);
  const VI longest = hn::Max(hn::Max(hn::Abs(x1), hn::Abs(y1)), hn::Max(hn::Abs(x2), hn::Abs(y2)));
  const auto sliver = hn::RebindMask(df, hn::Lt(twice_area, hn::ShiftLeft<2>(longest)));
  const VF per_area =
      hn::Div(hn::Set(df, float{kSubPixels}), hn::ConvertTo(df, hn::Max(twice_area, hn::Set(di, 1))));
  const VF right =
      hn::Mul(hn::Sub(hn::Mul(z1, hn::ConvertTo(df, y2)), hn::Mul(z2, hn::ConvertTo(df, y1))), per_area);
  const VF down =
      hn::Mul(hn::Sub(hn::Mul(z2, hn::ConvertTo(df, x1)), hn::Mul(z1, hn::ConvertTo(df, x2))), per_area);
  const VF per_pixel = hn::Set(df, -1.0f / kSubPixels);
  const VF c = hn::Add(az, hn::Add(hn::Mul(right, hn::Mul(hn::ConvertTo(df, ax), per_pixel)),
                                   hn::Mul(down, hn::Mul(hn::ConvertTo(df, ay), per_pixel))));
  const VF mean = hn::Mul(hn::Add(hn::Add(az, bz), cz), hn::Set(df, 1.0f / 3.0f));
  return {hn::IfThenElse(sliver, mean, c), hn::IfThenZeroElse(sliver, right),
          hn::IfThenZeroElse(sliver, down)};
}

// Pixels whose centres lie in [low, high] (sub-pixels): the first and the last.
HWY_INLINE VI FirstPixel(VI low) {
  return hn::ShiftRight<kSubPixelBits>(hn::Add(low, hn::Set(DI(), kSubPixels - 1)));
}
HWY_INLINE VI LastPixel(VI high) { return hn::ShiftRight<kSubPixelBits>(high); }

// Projection (RasterLens::Project) of several points of the camera frame.
struct ProjectedLanes {
  VI x, y;
  VF inverse_z;
  VI outcode;
};
HWY_INLINE ProjectedLanes ProjectLanes(const RasterLens& lens, VF x, VF y, VF z) {
  const DF df;
  const DI di;
  const VF largest_m = hn::Set(df, 1e6f);
  const VF largest_px = hn::Set(df, 65536.0f);
  const VF one = hn::Set(df, 1.0f);
  const VF two = hn::Set(df, 2.0f);
  const auto finite = hn::And(hn::And(hn::Lt(hn::Abs(x), largest_m), hn::Lt(hn::Abs(y), largest_m)),
                              hn::Lt(hn::Abs(z), largest_m));
  auto bit = [&](auto mask, std::uint32_t code) {
    return hn::IfThenElseZero(hn::RebindMask(di, mask), hn::Set(di, static_cast<std::int32_t>(code)));
  };
  VI outcode = hn::Or(hn::Or(bit(hn::Lt(x, hn::Mul(hn::Set(df, lens.view_x0), z)), kLeft),
                             bit(hn::Gt(x, hn::Mul(hn::Set(df, lens.view_x1), z)), kRight)),
                      hn::Or(bit(hn::Lt(y, hn::Mul(hn::Set(df, lens.view_y0), z)), kAbove),
                             bit(hn::Gt(y, hn::Mul(hn::Set(df, lens.view_y1), z)), kBelow)));
  const auto near = hn::Lt(z, hn::Set(df, lens.near_m));
  const VF inverse_z = hn::Div(one, z);
  const VF nx = hn::Mul(x, inverse_z);
  const VF ny = hn::Mul(y, inverse_z);
  const VF xx = hn::Mul(nx, nx);
  const VF yy = hn::Mul(ny, ny);
  const VF r2 = hn::Add(xx, yy);
  auto horner = [&](float a, float b, float c) {
    const VF inner = hn::Add(hn::Set(df, b), hn::Mul(r2, hn::Set(df, c)));
    return hn::Add(one, hn::Mul(r2, hn::Add(hn::Set(df, a), hn::Mul(r2, inner))));
  };
  const VF g = hn::Div(horner(lens.k1, lens.k2, lens.k3), horner(lens.k4, lens.k5, lens.k6));
  const VF two_xy = hn::Mul(two, hn::Mul(nx, ny));
  const VF p1 = hn::Set(df, lens.p1);
  const VF p2 = hn::Set(df, lens.p2);
  const VF dx =
      hn::Add(hn::Mul(nx, g), hn::Add(hn::Mul(p1, two_xy), hn::Mul(p2, hn::Add(r2, hn::Mul(two, xx)))));
  const VF dy =
      hn::Add(hn::Mul(ny, g), hn::Add(hn::Mul(p1, hn::Add(r2, hn::Mul(two, yy))), hn::Mul(p2, two_xy)));
  const VF u = hn::Add(hn::Mul(hn::Set(df, lens.fx), dx), hn::Set(df, lens.cx));
  const VF v = hn::Add(hn::Mul(hn::Set(df, lens.fy), dy), hn::Set(df, lens.cy));
  const auto pixel = hn::And(hn::Lt(r2, hn::Set(df, lens.fold_r2)),
                             hn::And(hn::Lt(hn::Abs(u), largest_px), hn::Lt(hn::Abs(v), largest_px)));
  outcode = hn::Or(outcode, hn::IfThenElse(hn::RebindMask(di, near), hn::Set(di, std::int32_t{kNear}),
                                           hn::IfThenZeroElse(hn::RebindMask(di, pixel),
                                                              hn::Set(di, std::int32_t{kNoPixel}))));
  outcode = hn::IfThenElse(hn::RebindMask(di, finite), outcode, hn::Set(di, std::int32_t{kNotFinite}));
  const auto seen = hn::RebindMask(di, hn::And(finite, hn::AndNot(near, pixel)));
  const VF sub = hn::Set(df, float{kSubPixels});
  // Lanes without a pixel are zeroed before the conversion: what they hold may not fit an integer.
  const auto seen_f = hn::RebindMask(df, seen);
  return {hn::NearestInt(hn::IfThenElseZero(seen_f, hn::Mul(u, sub))),
          hn::NearestInt(hn::IfThenElseZero(seen_f, hn::Mul(v, sub))),
          hn::IfThenElseZero(hn::And(finite, hn::Not(near)), inverse_z), outcode};
}

}  // namespace mixstage::raster::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
