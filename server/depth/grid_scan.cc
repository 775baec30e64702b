// SPDX-License-Identifier: Apache-2.0
#include "server/depth/grid_scan.h"

#include <algorithm>
#include <utility>

#include "server/depth/depth_grid.h"

namespace mixstage::depth {
namespace {

using raster::kMaxEdgePx;
using raster::kSubPixelBits;
using raster::kSubPixels;
using raster::ScanTarget;

struct Corner {
  std::int32_t x, y;
  float inverse_z;
};

struct Edge {
  std::int32_t c, right, down;
  [[nodiscard]] bool Holds(int i, int j) const { return c + right * i + down * j >= 0; }
};
Edge EdgeOf(const Corner& a, const Corner& b) {
  const std::int32_t dx = b.x - a.x;
  const std::int32_t dy = b.y - a.y;
  const bool top_left = dy < 0 || (dy == 0 && dx > 0);
  return {(dy * a.x - dx * a.y - (top_left ? 0 : 1)) >> kSubPixelBits, -dy, dx};
}

std::int32_t TwiceArea(const Corner& a, const Corner& b, const Corner& c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

struct Plane {
  float c, right, down;
};
// As the rasteriser's (scan_scalar.cc): slivers thinner than 1/64 px are flat.
Plane PlaneOf(const Corner& a, const Corner& b, const Corner& c) {
  const std::int32_t twice_area = TwiceArea(a, b, c);
  const std::int32_t x1 = b.x - a.x, y1 = b.y - a.y, x2 = c.x - a.x, y2 = c.y - a.y;
  const std::int32_t longest = std::max({std::abs(x1), std::abs(y1), std::abs(x2), std::abs(y2)});
  if (twice_area < 4 * longest) return {(a.inverse_z + b.inverse_z + c.inverse_z) * (1.0f / 3.0f), 0, 0};
  auto f = [](std::int32_t v) { return static_cast<float>(v); };
  const float z1 = b.inverse_z - a.inverse_z;
  const float z2 = c.inverse_z - a.inverse_z;
  const float per_area = float{kSubPixels} / f(twice_area);
  Plane plane{};
  plane.right = (z1 * f(y2) - z2 * f(y1)) * per_area;
  plane.down = (z2 * f(x1) - z1 * f(x2)) * per_area;
  constexpr float kPerPixel = -1.0f / kSubPixels;
  plane.c = a.inverse_z + (plane.right * (f(a.x) * kPerPixel) + plane.down * (f(a.y) * kPerPixel));
  return plane;
}

// Calls pixel(value in the target, 1/z) for every pixel of the cells.
template <typename Pixel>
void ForEachPixel(const CellRun& run, const ScanTarget& target, Pixel pixel) {
  for (std::size_t i = 0; i < run.count; ++i) {
    const int parts = run.cells[i] & kWhole;
    if (parts == 0) continue;
    // Top left, top right, bottom left, bottom right; turned: a quarter turn clockwise.
    constexpr std::size_t kStraight[4] = {0, 1, 2, 3};
    constexpr std::size_t kQuarter[4] = {1, 3, 0, 2};
    const auto& order = (run.cells[i] & kTurned) != 0 ? kQuarter : kStraight;
    Corner q[4];
    std::int32_t any = 0;
    auto take = [&](std::size_t to, std::size_t from) {
      const CellRun::Corner& c = run.corners[order[from]];
      q[to] = {c.x[i], c.y[i], c.inverse_z[i]};
      any |= c.outcode[i];
    };
    // A corner of no part is replaced by one of the other part: it must not count.
    take(0, (parts & kUpper) != 0 ? 0 : 3);
    take(1, 1);
    take(2, 2);
    take(3, (parts & kLower) != 0 ? 3 : 0);
    if ((any & ~std::int32_t{raster::kOutsideMask & ~raster::kNear}) != 0) continue;
    const auto [min_x, max_x] = std::minmax({q[0].x, q[1].x, q[2].x, q[3].x});
    const auto [min_y, max_y] = std::minmax({q[0].y, q[1].y, q[2].y, q[3].y});
    if (std::max(max_x - min_x, max_y - min_y) > kMaxEdgePx * kSubPixels) continue;
    const int x0 = std::max((min_x + kSubPixels - 1) >> kSubPixelBits, target.x0);
    const int x1 = std::min(max_x >> kSubPixelBits, target.x1);
    const int y0 = std::max((min_y + kSubPixels - 1) >> kSubPixelBits, target.y0);
    const int y1 = std::min(max_y >> kSubPixelBits, target.y1);
    if (x0 > x1 || y0 > y1) continue;
    for (Corner& c : q) c.x -= x0 * kSubPixels, c.y -= y0 * kSubPixels;
    // The parts ask too: a part that is not there has the other's corners, turned round.
    const bool upper = (parts & kUpper) != 0 && TwiceArea(q[0], q[1], q[2]) > 0;
    const bool lower = (parts & kLower) != 0 && TwiceArea(q[1], q[3], q[2]) > 0;
    if (!upper && !lower) continue;
    const Edge diagonal = EdgeOf(q[1], q[2]);
    const Edge upper_edges[2] = {EdgeOf(q[0], q[1]), EdgeOf(q[2], q[0])};
    const Edge lower_edges[2] = {EdgeOf(q[1], q[3]), EdgeOf(q[3], q[2])};
    const Plane upper_plane = PlaneOf(q[0], q[1], q[2]);
    const Plane lower_plane = PlaneOf(q[1], q[3], q[2]);
    for (int column = 0; column <= x1 - x0; ++column) {
      float upper_z = upper_plane.c + upper_plane.right * static_cast<float>(column);
      float lower_z = lower_plane.c + lower_plane.right * static_cast<float>(column);
      for (int row = 0; row <= y1 - y0; ++row) {
        const bool in_upper = diagonal.Holds(column, row);
        const bool there = in_upper ? upper : lower;
        const Edge* edges = in_upper ? upper_edges : lower_edges;
        if (there && edges[0].Holds(column, row) && edges[1].Holds(column, row)) {
          pixel(target.inverse_z[(y0 + row) * target.stride + x0 + column], in_upper ? upper_z : lower_z);
        }
        upper_z += upper_plane.down;
        lower_z += lower_plane.down;
      }
    }
  }
}

}  // namespace

void CornerRays::Resize(std::size_t count) {
  for (auto* field : {&x, &y, &z}) field->resize(count + 8, 0.0f);
}
void GridCorners::Resize(std::size_t count) {
  for (auto* field : {&x, &y, &outcode}) field->resize(count + 8, 0);
  inverse_z.resize(count + 8, 0.0f);
}

void ProjectCornersScalar(const raster::RasterLens& lens, const float t[3], const CornerRays& rays,
                          const float* depth_z, std::size_t first, std::size_t count, GridCorners& out) {
  for (std::size_t i = first; i < first + count; ++i) {
    const Eigen::Vector3f p(rays.x[i] * depth_z[i] + t[0], rays.y[i] * depth_z[i] + t[1],
                            rays.z[i] * depth_z[i] + t[2]);
    const raster::ProjectedVertex v = lens.Project(p);
    out.x[i] = v.x;
    out.y[i] = v.y;
    out.inverse_z[i] = v.inverse_z;
    out.outcode[i] = static_cast<std::int32_t>(v.outcode);
  }
}

void ScanCellsScalar(const CellRun& run, const ScanTarget& target) {
  ForEachPixel(run, target, [](float& held, float inverse_z) { held = std::max(held, inverse_z); });
}

void EraseBehindCellsScalar(const CellRun& run, const ScanTarget& target) {
  ForEachPixel(run, target, [](float& held, float inverse_z) {
    if (inverse_z > held) held = 0;
  });
}

}  // namespace mixstage::depth
