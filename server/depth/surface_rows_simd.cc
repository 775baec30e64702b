// SPDX-License-Identifier: Apache-2.0
//
// Vector twins of surface_rows.cc; remainders run over into the border.

// GCC fuses a product and a sum wherever the instruction set can; the scalar code's bits need them apart.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#endif

#include "server/depth/surface_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/depth/surface_rows_simd.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage::depth::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Eight at most: rows have a border of eight.
using DF = hn::CappedTag<float, 8>;
using DI = hn::RebindToSigned<DF>;
using VF = hn::Vec<DF>;

HWY_INLINE void Sort(VF& p, VF& q) {
  const VF low = hn::Min(p, q);
  q = hn::Max(p, q);
  p = low;
}

void MedianRowImpl(const float* above, const float* row, const float* below, int width, float* median) {
  const DF df;
  const VF zero = hn::Zero(df);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(df))) {
    const VF centre = hn::LoadU(df, row + x);
    auto of = [&](const float* from) HWY_ATTR {
      const VF v = hn::LoadU(df, from + x);
      return hn::IfThenElse(hn::Gt(v, zero), v, centre);
    };
    VF a = of(above - 1), b = of(above), c = of(above + 1);
    VF d = of(row - 1), e = centre, f = of(row + 1);
    VF g = of(below - 1), h = of(below), i = of(below + 1);
    Sort(b, c), Sort(e, f), Sort(h, i), Sort(a, b), Sort(d, e), Sort(g, h), Sort(b, c), Sort(e, f),
        Sort(h, i);
    d = hn::Max(a, d);
    f = hn::Min(f, i);
    Sort(e, h);
    e = hn::Max(b, e);
    g = hn::Max(d, g);
    c = hn::Min(c, f);
    e = hn::Min(e, h);
    Sort(e, c);
    e = hn::Max(g, e);
    hn::StoreU(hn::IfThenElseZero(hn::Gt(centre, zero), hn::Min(e, c)), df, median + x);
  }
}

void CutRowImpl(const float* z, const float* limit, std::ptrdiff_t next, float pitch, int width,
                std::uint8_t* cut) {
  const DF df;
  const DI di;
  const hn::Rebind<std::int8_t, DI> d8;
  const VF zero = hn::Zero(df);
  for (int x = 0; x < width; x += static_cast<int>(hn::Lanes(df))) {
    const VF p = hn::LoadU(df, z + x);
    const VF q = hn::LoadU(df, z + x + next);
    const VF before_p = hn::LoadU(df, z + x - next);
    const VF beyond_q = hn::LoadU(df, z + x + 2 * next);
    const VF step = hn::Sub(q, p);
    const auto falls = hn::Lt(step, zero);
    auto along = [&](VF v) HWY_ATTR { return hn::IfThenElse(falls, hn::Neg(v), v); };
    auto slope = [&](VF there, VF difference) HWY_ATTR {
      return hn::IfThenElseZero(hn::Gt(there, zero), hn::Max(zero, along(difference)));
    };
    const VF before = slope(before_p, hn::Sub(p, before_p));
    const VF beyond = slope(beyond_q, hn::Sub(beyond_q, q));
    const VF lateral = hn::Mul(hn::Set(df, pitch), hn::Min(p, q));
    const VF explained =
        hn::Max(hn::Min(hn::Min(before, beyond), hn::Mul(hn::Set(df, kSlopeOfBothSides), lateral)),
                hn::Min(hn::Max(before, beyond), hn::Mul(hn::Set(df, kSlopeOfOneSide), lateral)));
    const VF excess = hn::Sub(along(step), explained);
    const VF least = hn::Max(hn::LoadU(df, limit + x), hn::LoadU(df, limit + x + next));
    const auto is_cut = hn::VecFromMask(di, hn::RebindMask(di, hn::Gt(excess, least)));
    hn::StoreU(hn::DemoteTo(d8, is_cut), d8, reinterpret_cast<std::int8_t*>(cut + x));
  }
}

}  // namespace mixstage::depth::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage::depth {

HWY_EXPORT(MedianRowImpl);
HWY_EXPORT(CutRowImpl);

void MedianRow(const float* above, const float* row, const float* below, int width, float* median) {
  HWY_DYNAMIC_DISPATCH(MedianRowImpl)(above, row, below, width, median);
}
void CutRow(const float* z, const float* limit, std::ptrdiff_t next, float pitch, int width,
            std::uint8_t* cut) {
  HWY_DYNAMIC_DISPATCH(CutRowImpl)(z, limit, next, pitch, width, cut);
}

}  // namespace mixstage::depth
#endif
