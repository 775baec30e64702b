// SPDX-License-Identifier: Apache-2.0
//
// Vector twins of grid_scan.cc: set-up for as many cells as there are lanes, then one row of one cell (both
// triangles) per vector. Remainders run over into padding.

// GCC fuses a product and a sum wherever the instruction set can; the scalar code's bits need them apart.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#endif

#include <algorithm>

#include "server/depth/depth_grid.h"
#include "server/depth/grid_scan.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/depth/grid_scan_simd.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

#include "server/raster/scan-inl.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage::depth::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;
namespace rn = mixstage::raster::HWY_NAMESPACE;
using raster::kMaxEdgePx;
using raster::kSubPixelBits;
using raster::kSubPixels;
using raster::ScanTarget;
using rn::DF;
using rn::DI;
using rn::kMaxLanes;
using rn::MI;
using rn::VF;
using rn::VI;

void ProjectCornersImpl(const raster::RasterLens& lens, const float* t, const CornerRays& rays,
                        const float* depth_z, std::size_t first, std::size_t count, GridCorners& out) {
  const DF df;
  const DI di;
  for (std::size_t i = first; i < first + count; i += hn::Lanes(df)) {
    const VF depth = hn::LoadU(df, depth_z + i);
    auto along = [&](const std::vector<float>& ray, float offset) HWY_ATTR {
      return hn::Add(hn::Mul(hn::LoadU(df, ray.data() + i), depth), hn::Set(df, offset));
    };
    const rn::ProjectedLanes p =
        rn::ProjectLanes(lens, along(rays.x, t[0]), along(rays.y, t[1]), along(rays.z, t[2]));
    hn::StoreU(p.x, di, out.x.data() + i);
    hn::StoreU(p.y, di, out.y.data() + i);
    hn::StoreU(p.inverse_z, df, out.inverse_z.data() + i);
    hn::StoreU(p.outcode, di, out.outcode.data() + i);
  }
}

// Edges: diagonal (top right to bottom left), the two others of the upper triangle, the two others of the
// lower.
struct alignas(64) CellLanes {
  float edge_c[5][kMaxLanes], edge_right[5][kMaxLanes], edge_down[5][kMaxLanes];
  float z_c[2][kMaxLanes], z_right[2][kMaxLanes], z_down[2][kMaxLanes];
  std::int32_t x0[kMaxLanes], y0[kMaxLanes], x1[kMaxLanes], y1[kMaxLanes];
};

template <bool kErase>
HWY_INLINE void ScanOne(const CellLanes& s, std::size_t k, const ScanTarget& target) {
  const DF df;
  const DI di;
  const int lanes = static_cast<int>(hn::Lanes(df));
  const int columns = s.x1[k] - s.x0[k] + 1;
  const int rows = s.y1[k] - s.y0[k] + 1;
  float* origin = target.inverse_z + s.y0[k] * target.stride + s.x0[k];
  const VF down0 = hn::Set(df, s.edge_down[0][k]);
  const VF down1 = hn::Set(df, s.edge_down[1][k]);
  const VF down2 = hn::Set(df, s.edge_down[2][k]);
  const VF down3 = hn::Set(df, s.edge_down[3][k]);
  const VF down4 = hn::Set(df, s.edge_down[4][k]);
  const VF upper_down = hn::Set(df, s.z_down[0][k]);
  const VF lower_down = hn::Set(df, s.z_down[1][k]);
  for (int i = 0; i < columns; i += lanes) {
    const VF column = hn::Iota(df, static_cast<float>(i));
    auto start = [&](const float* c, const float* right)
                     HWY_ATTR { return hn::Add(hn::Set(df, c[k]), hn::Mul(hn::Set(df, right[k]), column)); };
    VF e0 = start(s.edge_c[0], s.edge_right[0]);
    VF e1 = start(s.edge_c[1], s.edge_right[1]);
    VF e2 = start(s.edge_c[2], s.edge_right[2]);
    VF e3 = start(s.edge_c[3], s.edge_right[3]);
    VF e4 = start(s.edge_c[4], s.edge_right[4]);
    VF upper_z = start(s.z_c[0], s.z_right[0]);
    VF lower_z = start(s.z_c[1], s.z_right[1]);
    float* inverse_z = origin + i;
    for (int j = 0; j < rows; ++j, inverse_z += target.stride) {
      const auto in_lower = hn::Lt(e0, hn::Zero(df));
      const VF outside = hn::IfThenElse(in_lower, hn::Or(e3, e4), hn::Or(e1, e2));
      const VF z = hn::IfThenElse(in_lower, lower_z, upper_z);
      // As an integer: the bits of two floats may read as a NaN.
      const auto covered = hn::RebindMask(df, hn::Not(hn::Lt(hn::BitCast(di, outside), hn::Zero(di))));
      const VF held = hn::LoadU(df, inverse_z);
      const VF here = hn::IfThenElseZero(covered, z);
      if constexpr (kErase) {
        hn::StoreU(hn::IfThenZeroElse(hn::Gt(here, held), held), df, inverse_z);
      } else {
        hn::StoreU(hn::Max(held, here), df, inverse_z);
      }
      e0 = hn::Add(e0, down0);
      e1 = hn::Add(e1, down1);
      e2 = hn::Add(e2, down2);
      e3 = hn::Add(e3, down3);
      e4 = hn::Add(e4, down4);
      upper_z = hn::Add(upper_z, upper_down);
      lower_z = hn::Add(lower_z, lower_down);
    }
  }
}

template <bool kErase>
void ScanCellsOf(const CellRun& run, const ScanTarget& target) {
  const DF df;
  const DI di;
  const hn::Rebind<std::uint8_t, DI> du8;
  const std::size_t lanes = hn::Lanes(df);
  const VI zero = hn::Zero(di);
  CellLanes s;
  for (std::size_t first = 0; first < run.count; first += lanes) {
    const VI cells = hn::PromoteTo(di, hn::LoadU(du8, run.cells + first));
    auto has = [&](std::int32_t bit) HWY_ATTR { return hn::Ne(hn::And(cells, hn::Set(di, bit)), zero); };
    const MI has_upper = has(kUpper);
    const MI has_lower = has(kLower);
    MI live = hn::And(hn::Or(has_upper, has_lower), hn::FirstN(di, run.count - first));
    if (hn::AllFalse(di, live)) continue;
    const MI turned = has(kTurned);

    VI x[4], y[4], outcode[4];
    VF inverse_z[4];
    auto load = [&](std::size_t to, std::size_t straight, std::size_t quarter) HWY_ATTR {
      const CellRun::Corner& a = run.corners[straight];
      const CellRun::Corner& b = run.corners[quarter];
      auto pick = [&](const std::int32_t* p, const std::int32_t* q) HWY_ATTR {
        return hn::IfThenElse(turned, hn::LoadU(di, q + first), hn::LoadU(di, p + first));
      };
      x[to] = pick(a.x, b.x);
      y[to] = pick(a.y, b.y);
      outcode[to] = pick(a.outcode, b.outcode);
      inverse_z[to] = hn::IfThenElse(hn::RebindMask(df, turned), hn::LoadU(df, b.inverse_z + first),
                                     hn::LoadU(df, a.inverse_z + first));
    };
    load(0, 0, 1);
    load(1, 1, 3);
    load(2, 2, 0);
    load(3, 3, 2);
    auto replace = [&](const MI& keep, std::size_t to, std::size_t from) HWY_ATTR {
      x[to] = hn::IfThenElse(keep, x[to], x[from]);
      y[to] = hn::IfThenElse(keep, y[to], y[from]);
      outcode[to] = hn::IfThenElse(keep, outcode[to], outcode[from]);
      inverse_z[to] = hn::IfThenElse(hn::RebindMask(df, keep), inverse_z[to], inverse_z[from]);
    };
    replace(has_upper, 0, 3);
    replace(has_lower, 3, 0);
    const VI any = hn::Or(hn::Or(outcode[0], outcode[1]), hn::Or(outcode[2], outcode[3]));
    live = hn::And(
        live,
        hn::Eq(hn::AndNot(hn::Set(di, std::int32_t{raster::kOutsideMask & ~raster::kNear}), any), zero));

    const VI min_x = hn::Min(hn::Min(x[0], x[1]), hn::Min(x[2], x[3]));
    const VI max_x = hn::Max(hn::Max(x[0], x[1]), hn::Max(x[2], x[3]));
    const VI min_y = hn::Min(hn::Min(y[0], y[1]), hn::Min(y[2], y[3]));
    const VI max_y = hn::Max(hn::Max(y[0], y[1]), hn::Max(y[2], y[3]));
    const VI extent = hn::Max(hn::Sub(max_x, min_x), hn::Sub(max_y, min_y));
    live = hn::And(live, hn::Not(hn::Gt(extent, hn::Set(di, kMaxEdgePx * kSubPixels))));
    const VI x0 = hn::Max(rn::FirstPixel(min_x), hn::Set(di, target.x0));
    const VI x1 = hn::Min(rn::LastPixel(max_x), hn::Set(di, target.x1));
    const VI y0 = hn::Max(rn::FirstPixel(min_y), hn::Set(di, target.y0));
    const VI y1 = hn::Min(rn::LastPixel(max_y), hn::Set(di, target.y1));
    live = hn::And(live, hn::Not(hn::Or(hn::Gt(x0, x1), hn::Gt(y0, y1))));

    const VI upper_area = rn::TwiceArea(x[0], y[0], x[1], y[1], x[2], y[2]);
    const VI lower_area = rn::TwiceArea(x[1], y[1], x[3], y[3], x[2], y[2]);
    const MI upper = hn::And(has_upper, hn::Gt(upper_area, zero));
    const MI lower = hn::And(has_lower, hn::Gt(lower_area, zero));
    live = hn::And(live, hn::Or(upper, lower));
    if (hn::AllFalse(di, live)) continue;

    const VI origin_x = hn::ShiftLeft<kSubPixelBits>(x0);
    const VI origin_y = hn::ShiftLeft<kSubPixelBits>(y0);
    for (std::size_t k = 0; k < 4; ++k) {
      x[k] = hn::Sub(x[k], origin_x);
      y[k] = hn::Sub(y[k], origin_y);
    }
    auto edge = [&](std::size_t e, std::size_t a, std::size_t b, const MI& there) HWY_ATTR {
      const rn::EdgeLanes lane = rn::SetUpEdge(x[a], y[a], x[b], y[b]);
      const auto mask = hn::RebindMask(df, there);
      // An edge of a part that is not there: outside everywhere.
      hn::Store(hn::IfThenElse(mask, lane.c, hn::Set(df, -1.0f)), df, s.edge_c[e]);
      hn::Store(hn::IfThenElseZero(mask, lane.right), df, s.edge_right[e]);
      hn::Store(hn::IfThenElseZero(mask, lane.down), df, s.edge_down[e]);
    };
    edge(0, 1, 2, hn::Or(upper, lower));
    edge(1, 0, 1, upper);
    edge(2, 2, 0, upper);
    edge(3, 1, 3, lower);
    edge(4, 3, 2, lower);
    auto plane = [&](std::size_t to, std::size_t a, std::size_t b, std::size_t c, VI area) HWY_ATTR {
      const rn::PlaneLanes lane =
          rn::SetUpPlane(x[a], y[a], inverse_z[a], x[b], y[b], inverse_z[b], x[c], y[c], inverse_z[c], area);
      hn::Store(lane.c, df, s.z_c[to]);
      hn::Store(lane.right, df, s.z_right[to]);
      hn::Store(lane.down, df, s.z_down[to]);
    };
    plane(0, 0, 1, 2, upper_area);
    plane(1, 1, 3, 2, lower_area);
    hn::Store(x0, di, s.x0);
    hn::Store(y0, di, s.y0);
    hn::Store(x1, di, s.x1);
    hn::Store(y1, di, s.y1);

    std::uint8_t live_bits[8] = {};
    hn::StoreMaskBits(di, live, live_bits);
    for (unsigned bits = live_bits[0]; bits != 0; bits &= bits - 1) {
      ScanOne<kErase>(s, static_cast<std::size_t>(__builtin_ctz(bits)), target);
    }
  }
}

void ScanCellsImpl(const CellRun& run, const ScanTarget& target) { ScanCellsOf<false>(run, target); }
void EraseBehindCellsImpl(const CellRun& run, const ScanTarget& target) { ScanCellsOf<true>(run, target); }

void TakeDepthImpl(float* inverse_z, float* depth_m, std::size_t count) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  const auto one = hn::Set(d, 1.0f);
  const auto zero = hn::Zero(d);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto v = hn::LoadU(d, inverse_z + i);
    hn::StoreU(zero, d, inverse_z + i);
    hn::StoreU(hn::IfThenElseZero(hn::Gt(v, zero), hn::Div(one, v)), d, depth_m + i);
  }
  for (; i < count; ++i) {
    depth_m[i] = inverse_z[i] > 0 ? 1.0f / inverse_z[i] : 0.0f;
    inverse_z[i] = 0;
  }
}

}  // namespace mixstage::depth::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage::depth {

HWY_EXPORT(ProjectCornersImpl);
HWY_EXPORT(ScanCellsImpl);
HWY_EXPORT(EraseBehindCellsImpl);
HWY_EXPORT(TakeDepthImpl);

void ProjectCorners(const raster::RasterLens& lens, const float t[3], const CornerRays& rays,
                    const float* depth_z, std::size_t first, std::size_t count, GridCorners& out) {
  HWY_DYNAMIC_DISPATCH(ProjectCornersImpl)(lens, t, rays, depth_z, first, count, out);
}
void ScanCells(const CellRun& run, const raster::ScanTarget& target) {
  HWY_DYNAMIC_DISPATCH(ScanCellsImpl)(run, target);
}
void EraseBehindCells(const CellRun& run, const raster::ScanTarget& target) {
  HWY_DYNAMIC_DISPATCH(EraseBehindCellsImpl)(run, target);
}
void TakeDepth(float* inverse_z, float* depth_m, std::size_t count) {
  HWY_DYNAMIC_DISPATCH(TakeDepthImpl)(inverse_z, depth_m, count);
}

}  // namespace mixstage::depth
#endif
