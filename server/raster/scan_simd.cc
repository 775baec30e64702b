// SPDX-License-Identifier: Apache-2.0
//
// Vector twins of ScanTrianglesScalar and ProjectVerticesScalar: set-up for as many triangles as there are
// lanes, then one row of one triangle per vector. Remainders of either are padded, never read beyond.

// GCC fuses a product and a sum wherever the instruction set can; the scalar code's bits need them apart.
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#endif

#include <algorithm>
#include <array>
#include <cstring>

#include "proto/base/check.h"
#include "server/raster/raster_lens.h"
#include "server/raster/scan.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/raster/scan_simd.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

#include "server/raster/scan-inl.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage::raster::HWY_NAMESPACE {

static_assert(sizeof(Eigen::Vector3f) == 3 * sizeof(float));

void ProjectVerticesImpl(const RasterLens& lens, const Affine34& T, const float* xyz, std::size_t count,
                         ProjectedVertex* out) {
  const DF df;
  const DI di;
  const std::size_t lanes = hn::Lanes(df);
  auto project = [&](const float* from, ProjectedVertex* to) HWY_ATTR {
    VF x, y, z;
    hn::LoadInterleaved3(df, from, x, y, z);
    auto row = [&](int r) HWY_ATTR {
      const VF xy = hn::Add(hn::Mul(hn::Set(df, T.m[r][0]), x), hn::Mul(hn::Set(df, T.m[r][1]), y));
      return hn::Add(hn::Add(xy, hn::Mul(hn::Set(df, T.m[r][2]), z)), hn::Set(df, T.m[r][3]));
    };
    const ProjectedLanes p = ProjectLanes(lens, row(0), row(1), row(2));
    hn::StoreInterleaved4(p.x, p.y, hn::BitCast(di, p.inverse_z), p.outcode, di,
                          reinterpret_cast<std::int32_t*>(to));
  };
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) project(xyz + 3 * i, out + i);
  if (i < count) {
    std::array<float, 3 * kMaxLanes> in{};
    std::array<ProjectedVertex, kMaxLanes> rest{};
    std::memcpy(in.data(), xyz + 3 * i, (count - i) * 3 * sizeof(float));
    project(in.data(), rest.data());
    std::copy_n(rest.data(), count - i, out + i);
  }
}

// Set-up of up to kMaxLanes triangles, one field after the other so that the set-up stores whole vectors.
struct alignas(64) TriangleLanes {
  float edge_c[3][kMaxLanes], edge_right[3][kMaxLanes], edge_down[3][kMaxLanes];
  float z_c[kMaxLanes], z_right[kMaxLanes], z_down[kMaxLanes];
  std::int32_t x0[kMaxLanes], y0[kMaxLanes], x1[kMaxLanes], y1[kMaxLanes];
};

template <bool kIds>
HWY_INLINE void ScanOne(const TriangleLanes& s, std::size_t k, std::int32_t id, const ScanTarget& target) {
  const DF df;
  const DI di;
  const int lanes = static_cast<int>(hn::Lanes(df));
  const int x0 = s.x0[k];
  const int columns = s.x1[k] - x0 + 1;
  const int rows = s.y1[k] - s.y0[k] + 1;
  const std::ptrdiff_t origin = s.y0[k] * target.stride + x0;
  const VF down0 = hn::Set(df, s.edge_down[0][k]);
  const VF down1 = hn::Set(df, s.edge_down[1][k]);
  const VF down2 = hn::Set(df, s.edge_down[2][k]);
  const VF z_down = hn::Set(df, s.z_down[k]);
  const VI ids = hn::Set(di, id);
  for (int i = 0; i < columns; i += lanes) {
    const VF column = hn::Iota(df, static_cast<float>(i));
    const auto in_box = hn::Lt(column, hn::Set(df, static_cast<float>(columns)));
    auto start = [&](const float* c, const float* right)
                     HWY_ATTR { return hn::Add(hn::Set(df, c[k]), hn::Mul(hn::Set(df, right[k]), column)); };
    VF e0 = start(s.edge_c[0], s.edge_right[0]);
    VF e1 = start(s.edge_c[1], s.edge_right[1]);
    VF e2 = start(s.edge_c[2], s.edge_right[2]);
    VF z = start(s.z_c, s.z_right);
    float* inverse_z = target.inverse_z + origin + i;
    std::int32_t* triangle = kIds ? target.triangle + origin + i : nullptr;
    for (int j = 0; j < rows; ++j) {
      // The sign of any edge; as an integer, since the bits of three floats may read as a NaN.
      const MI outside = hn::Lt(hn::BitCast(di, hn::Or(hn::Or(e0, e1), e2)), hn::Zero(di));
      const auto inside = hn::AndNot(hn::RebindMask(df, outside), in_box);
      const VF old = hn::LoadU(df, inverse_z);
      const auto nearer = hn::And(inside, hn::Gt(z, old));
      hn::StoreU(hn::IfThenElse(nearer, z, old), df, inverse_z);
      if constexpr (kIds) {
        const VI old_id = hn::LoadU(di, triangle);
        hn::StoreU(hn::IfThenElse(hn::RebindMask(di, nearer), ids, old_id), di, triangle);
        triangle += target.stride;
      }
      inverse_z += target.stride;
      e0 = hn::Add(e0, down0);
      e1 = hn::Add(e1, down1);
      e2 = hn::Add(e2, down2);
      z = hn::Add(z, z_down);
    }
  }
}

template <bool kIds>
void ScanTrianglesOf(const ScanBatch& batch, const ScanTarget& target,
                     std::vector<std::uint32_t>& needs_split, TouchedBox& touched) {
  const DF df;
  const DI di;
  const std::size_t lanes = hn::Lanes(df);
  const auto* words = reinterpret_cast<const std::int32_t*>(batch.vertices.data());
  const std::size_t count = batch.indices.size() / 3;
  const VI zero = hn::Zero(di);
  VI touched_x0 = hn::Set(di, touched.x0), touched_y0 = hn::Set(di, touched.y0);
  VI touched_x1 = hn::Set(di, touched.x1), touched_y1 = hn::Set(di, touched.y1);
  TriangleLanes s;
  for (std::size_t first = 0; first < count; first += lanes) {
    const std::size_t valid = std::min(lanes, count - first);
    VI ia, ib, ic;
    if (valid == lanes) {
      hn::LoadInterleaved3(di, reinterpret_cast<const std::int32_t*>(batch.indices.data()) + 3 * first, ia,
                           ib, ic);
    } else {
      std::array<std::int32_t, 3 * kMaxLanes> rest{};  // corner 0 three times: no area
      std::memcpy(rest.data(), batch.indices.data() + 3 * first, 3 * valid * sizeof(std::int32_t));
      hn::LoadInterleaved3(di, rest.data(), ia, ib, ic);
    }
    ia = hn::ShiftLeft<2>(ia);
    ib = hn::ShiftLeft<2>(ib);
    ic = hn::ShiftLeft<2>(ic);
    auto gather = [&](int word, VI index) HWY_ATTR { return hn::GatherIndex(di, words + word, index); };
    const VI code_a = gather(3, ia), code_b = gather(3, ib), code_c = gather(3, ic);
    const VI any = hn::Or(hn::Or(code_a, code_b), code_c);
    const VI all = hn::And(hn::And(code_a, code_b), code_c);
    auto has = [&](VI code, std::uint32_t bits) HWY_ATTR {
      return hn::Ne(hn::And(code, hn::Set(di, static_cast<std::int32_t>(bits))), zero);
    };
    MI live = hn::Not(hn::Or(has(all, kOutsideMask), has(any, kNotFinite)));
    live = hn::And(live, hn::FirstN(di, valid));
    if (hn::AllFalse(di, live)) continue;

    const VI ax = gather(0, ia), ay = gather(1, ia);
    VI bx = gather(0, ib), by = gather(1, ib), cx = gather(0, ic), cy = gather(1, ic);
    const VI min_x = hn::Min(hn::Min(ax, bx), cx), max_x = hn::Max(hn::Max(ax, bx), cx);
    const VI min_y = hn::Min(hn::Min(ay, by), cy), max_y = hn::Max(hn::Max(ay, by), cy);
    const VI extent = hn::Max(hn::Sub(max_x, min_x), hn::Sub(max_y, min_y));
    const MI split =
        hn::And(live, hn::Or(has(any, kNeedsSplit), hn::Gt(extent, hn::Set(di, batch.max_edge))));
    if (!hn::AllFalse(di, split)) {
      std::uint8_t bits[8] = {};
      hn::StoreMaskBits(di, split, bits);
      for (std::size_t k = 0; k < valid; ++k) {
        if ((bits[0] >> k & 1) != 0) needs_split.push_back(static_cast<std::uint32_t>(first + k));
      }
      live = hn::AndNot(split, live);
    }
    const VI x0 = hn::Max(FirstPixel(min_x), hn::Set(di, target.x0));
    const VI x1 = hn::Min(LastPixel(max_x), hn::Set(di, target.x1));
    const VI y0 = hn::Max(FirstPixel(min_y), hn::Set(di, target.y0));
    const VI y1 = hn::Min(LastPixel(max_y), hn::Set(di, target.y1));
    live = hn::And(live, hn::Not(hn::Or(hn::Gt(x0, x1), hn::Gt(y0, y1))));

    VI twice_area = TwiceArea(ax, ay, bx, by, cx, cy);
    const MI negative = hn::Lt(twice_area, zero);
    if (batch.faces == Faces::kFrontOnly) {
      live = hn::And(live, batch.mirrored ? hn::Gt(twice_area, zero) : negative);
    } else {
      live = hn::And(live, hn::Ne(twice_area, zero));
    }
    if (hn::AllFalse(di, live)) continue;

    const VF az = hn::BitCast(df, gather(2, ia));
    VF bz = hn::BitCast(df, gather(2, ib)), cz = hn::BitCast(df, gather(2, ic));
    auto swap_where_negative = [&](VI& b, VI& c) HWY_ATTR {
      const VI kept = b;
      b = hn::IfThenElse(negative, c, b);
      c = hn::IfThenElse(negative, kept, c);
    };
    swap_where_negative(bx, cx);
    swap_where_negative(by, cy);
    const VF kept_z = bz;
    bz = hn::IfThenElse(hn::RebindMask(df, negative), cz, bz);
    cz = hn::IfThenElse(hn::RebindMask(df, negative), kept_z, cz);
    twice_area = hn::Abs(twice_area);

    const VI origin_x = hn::ShiftLeft<kSubPixelBits>(x0);
    const VI origin_y = hn::ShiftLeft<kSubPixelBits>(y0);
    const VI rax = hn::Sub(ax, origin_x), ray = hn::Sub(ay, origin_y);
    const VI rbx = hn::Sub(bx, origin_x), rby = hn::Sub(by, origin_y);
    const VI rcx = hn::Sub(cx, origin_x), rcy = hn::Sub(cy, origin_y);
    auto store_edge = [&](int e, const EdgeLanes& edge) HWY_ATTR {
      hn::Store(edge.c, df, s.edge_c[e]);
      hn::Store(edge.right, df, s.edge_right[e]);
      hn::Store(edge.down, df, s.edge_down[e]);
    };
    store_edge(0, SetUpEdge(rax, ray, rbx, rby));
    store_edge(1, SetUpEdge(rbx, rby, rcx, rcy));
    store_edge(2, SetUpEdge(rcx, rcy, rax, ray));
    const PlaneLanes plane = SetUpPlane(rax, ray, az, rbx, rby, bz, rcx, rcy, cz, twice_area);
    hn::Store(plane.c, df, s.z_c);
    hn::Store(plane.right, df, s.z_right);
    hn::Store(plane.down, df, s.z_down);
    hn::Store(x0, di, s.x0);
    hn::Store(y0, di, s.y0);
    hn::Store(x1, di, s.x1);
    hn::Store(y1, di, s.y1);
    touched_x0 = hn::IfThenElse(live, hn::Min(touched_x0, x0), touched_x0);
    touched_y0 = hn::IfThenElse(live, hn::Min(touched_y0, y0), touched_y0);
    touched_x1 = hn::IfThenElse(live, hn::Max(touched_x1, x1), touched_x1);
    touched_y1 = hn::IfThenElse(live, hn::Max(touched_y1, y1), touched_y1);

    std::uint8_t live_bits[8] = {};
    hn::StoreMaskBits(di, live, live_bits);
    for (unsigned bits = live_bits[0]; bits != 0; bits &= bits - 1) {
      const auto k = static_cast<std::size_t>(__builtin_ctz(bits));
      const std::int32_t id =
          batch.ids.empty() ? batch.first_id + static_cast<std::int32_t>(first + k) : batch.ids[first + k];
      ScanOne<kIds>(s, k, id, target);
    }
  }
  auto reduce = [&](VI v, auto better, int start) HWY_ATTR {
    alignas(64) std::int32_t values[kMaxLanes];
    hn::Store(v, di, values);
    for (std::size_t k = 0; k < lanes; ++k) start = better(start, values[k]);
    return start;
  };
  auto low = [](int a, int b) { return std::min(a, b); };
  auto high = [](int a, int b) { return std::max(a, b); };
  touched = {reduce(touched_x0, low, touched.x0), reduce(touched_y0, low, touched.y0),
             reduce(touched_x1, high, touched.x1), reduce(touched_y1, high, touched.y1)};
}

void ScanTrianglesImpl(const ScanBatch& batch, const ScanTarget& target,
                       std::vector<std::uint32_t>& needs_split, TouchedBox& touched) {
  if (target.triangle != nullptr) {
    ScanTrianglesOf<true>(batch, target, needs_split, touched);
  } else {
    ScanTrianglesOf<false>(batch, target, needs_split, touched);
  }
}

void InverseToDepthImpl(const float* inverse_z, float* depth_m, std::size_t count) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  const auto one = hn::Set(d, 1.0f);
  std::size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const auto v = hn::LoadU(d, inverse_z + i);
    hn::StoreU(hn::IfThenElseZero(hn::Gt(v, hn::Zero(d)), hn::Div(one, v)), d, depth_m + i);
  }
  for (; i < count; ++i) depth_m[i] = inverse_z[i] > 0 ? 1.0f / inverse_z[i] : 0.0f;
}

}  // namespace mixstage::raster::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage::raster {

HWY_EXPORT(ProjectVerticesImpl);
HWY_EXPORT(ScanTrianglesImpl);
HWY_EXPORT(InverseToDepthImpl);

void ProjectVertices(const RasterLens& lens, const Affine34& T_camera_object,
                     std::span<const Eigen::Vector3f> positions, std::span<ProjectedVertex> out) {
  MIX_CHECK(positions.size() == out.size());
  if (positions.empty()) return;
  HWY_DYNAMIC_DISPATCH(ProjectVerticesImpl)
  (lens, T_camera_object, positions[0].data(), positions.size(), out.data());
}

void ScanTriangles(const ScanBatch& batch, const ScanTarget& target, std::vector<std::uint32_t>& needs_split,
                   TouchedBox& touched) {
  MIX_CHECK(batch.max_edge <= kMaxEdgePx * kSubPixels);
  HWY_DYNAMIC_DISPATCH(ScanTrianglesImpl)(batch, target, needs_split, touched);
}

void InverseToDepth(const float* inverse_z, float* depth_m, std::size_t count) {
  HWY_DYNAMIC_DISPATCH(InverseToDepthImpl)(inverse_z, depth_m, count);
}

}  // namespace mixstage::raster
#endif
