// SPDX-License-Identifier: Apache-2.0
//
// Triples of vectors for the kernels; included once for every instruction set.
#if defined(MIXSTAGE_PROTO_SYNTHETIC_VECTORS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef MIXSTAGE_PROTO_SYNTHETIC_VECTORS_INL_H_
#undef MIXSTAGE_PROTO_SYNTHETIC_VECTORS_INL_H_
#else
#define MIXSTAGE_PROTO_SYNTHETIC_VECTORS_INL_H_
#endif

#include <hwy/highway.h>

#include <cstddef>

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

// At most 16 at once: tiles are multiples of that.
using Pixels = hn::CappedTag<float, 16>;

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

}  // namespace
}  // namespace mixstage::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // per target
