// SPDX-License-Identifier: Apache-2.0
#include "server/render/shadow_lookup.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/shadow_lookup_simd.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, 16>;
using V = hn::Vec<D>;
using M = hn::Mask<D>;

// Whether (x, y, z) from the lamp lies in the pyramid of a cube's face; where two are as large, as FaceOf
// (shadow_map.cc): z before y before x.
HWY_INLINE M InFace(int number, V x, V y, V z) {
  const D d;
  const V far_x = hn::Abs(x), far_y = hn::Abs(y), far_z = hn::Abs(z);
  const M is_z = hn::And(hn::Ge(far_z, far_x), hn::Ge(far_z, far_y));
  const M is_y = hn::AndNot(is_z, hn::Ge(far_y, far_x));
  const int axis = number / 2;
  const M on_axis = axis == 2 ? is_z : axis == 1 ? is_y : hn::Not(hn::Or(is_z, is_y));
  const M behind = hn::Lt(axis == 2 ? z : axis == 1 ? y : x, hn::Zero(d));
  return number % 2 == 0 ? hn::AndNot(behind, on_axis) : hn::And(behind, on_axis);
}

void LookUp(const ShadowFaceView& face, const PointRun& points, float bias_m, LitRun& lit) {
  const D d;
  const hn::RebindToSigned<D> di;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0f);
  const auto along = [&](std::size_t row, V x, V y, V z) HWY_ATTR {
    const float* R = face.R_face_scene.data() + 3 * row;
    return hn::MulAdd(hn::Set(d, R[0]), x, hn::MulAdd(hn::Set(d, R[1]), y, hn::Mul(hn::Set(d, R[2]), z)));
  };
  for (std::size_t k = 0; k < points.count; k += hn::Lanes(d)) {
    const V x = hn::Sub(hn::Load(d, points.x.data() + k), hn::Set(d, face.position[0]));
    const V y = hn::Sub(hn::Load(d, points.y.data() + k), hn::Set(d, face.position[1]));
    const V z = hn::Sub(hn::Load(d, points.z.data() + k), hn::Set(d, face.position[2]));
    const V ahead = along(2, x, y, z);
    M on = hn::Gt(ahead, zero);
    if (face.number >= 0) on = hn::And(on, InFace(face.number, x, y, z));
    const V scale = hn::Div(hn::Set(d, face.focal_px), ahead);
    const V u = hn::MulAdd(scale, along(0, x, y, z), hn::Set(d, face.center_px[0]));
    const V v = hn::MulAdd(scale, along(1, x, y, z), hn::Set(d, face.center_px[1]));
    on = hn::And(on, hn::And(hn::Ge(u, zero), hn::Lt(u, hn::Set(d, static_cast<float>(face.width - 1)))));
    on = hn::And(on, hn::And(hn::Ge(v, zero), hn::Lt(v, hn::Set(d, static_cast<float>(face.height - 1)))));
    if (hn::AllFalse(d, on)) continue;
    const auto left = hn::ConvertTo(di, hn::IfThenElseZero(on, u));
    const auto top = hn::ConvertTo(di, hn::IfThenElseZero(on, v));
    const V across = hn::Sub(u, hn::ConvertTo(d, left)), down = hn::Sub(v, hn::ConvertTo(d, top));
    const auto at = hn::Add(hn::Mul(top, hn::Set(di, face.stride)), left);
    const V nearest = hn::Sub(ahead, hn::Set(d, bias_m));
    const auto lit_at = [&](const float* pixel) HWY_ATTR {
      return hn::IfThenZeroElse(hn::Lt(hn::GatherIndex(d, pixel, at), nearest), one);
    };
    const float* above = face.depth_m;
    const float* below = face.depth_m + face.stride;
    const auto blend = [&](V share, V from, V to)
                           HWY_ATTR { return hn::MulAdd(share, hn::Sub(to, from), from); };
    const V of_above = blend(across, lit_at(above), lit_at(above + 1));
    const V of_below = blend(across, lit_at(below), lit_at(below + 1));
    float* to = lit.data() + k;
    hn::Store(hn::IfThenElse(on, blend(down, of_above, of_below), hn::Load(d, to)), d, to);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(LookUp);

void LookUpShadow(const ShadowFaceView& face, const PointRun& points, float bias_m, LitRun& lit) {
  HWY_DYNAMIC_DISPATCH(LookUp)(face, points, bias_m, lit);
}

}  // namespace mixstage
#endif  // HWY_ONCE
