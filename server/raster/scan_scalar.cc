// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cstdlib>

#include "server/raster/scan.h"

namespace mixstage::raster {
namespace {

struct Corner {
  std::int32_t x, y;  // sub-pixels, relative to the triangle's first pixel
  float inverse_z;
};

struct Edge {
  std::int32_t c, right, down;
};
Edge EdgeOf(const Corner& a, const Corner& b) {
  const std::int32_t dx = b.x - a.x;
  const std::int32_t dy = b.y - a.y;
  const bool top_left = dy < 0 || (dy == 0 && dx > 0);
  return {(dy * a.x - dx * a.y - (top_left ? 0 : 1)) >> kSubPixelBits, -dy, dx};
}

struct Plane {
  float c, right, down;
};
Plane PlaneOf(const Corner& a, const Corner& b, const Corner& c, std::int32_t twice_area) {
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

}  // namespace

void ScanTrianglesScalar(const ScanBatch& batch, const ScanTarget& target,
                         std::vector<std::uint32_t>& needs_split, TouchedBox& touched) {
  for (std::size_t t = 0; t < batch.indices.size() / 3; ++t) {
    const ProjectedVertex& a = batch.vertices[batch.indices[3 * t]];
    const ProjectedVertex* b = &batch.vertices[batch.indices[3 * t + 1]];
    const ProjectedVertex* c = &batch.vertices[batch.indices[3 * t + 2]];
    const std::uint32_t any = a.outcode | b->outcode | c->outcode;
    if ((a.outcode & b->outcode & c->outcode & kOutsideMask) != 0 || (any & kNotFinite) != 0) continue;
    const auto [min_x, max_x] = std::minmax({a.x, b->x, c->x});
    const auto [min_y, max_y] = std::minmax({a.y, b->y, c->y});
    if ((any & kNeedsSplit) != 0 || std::max(max_x - min_x, max_y - min_y) > batch.max_edge) {
      needs_split.push_back(static_cast<std::uint32_t>(t));
      continue;
    }
    const int x0 = std::max((min_x + kSubPixels - 1) >> kSubPixelBits, target.x0);
    const int x1 = std::min(max_x >> kSubPixelBits, target.x1);
    const int y0 = std::max((min_y + kSubPixels - 1) >> kSubPixelBits, target.y0);
    const int y1 = std::min(max_y >> kSubPixelBits, target.y1);
    if (x0 > x1 || y0 > y1) continue;

    std::int32_t twice_area = (b->x - a.x) * (c->y - a.y) - (b->y - a.y) * (c->x - a.x);
    // y points down: counter-clockwise for who looks at it is a negative area.
    const bool front = batch.mirrored ? twice_area > 0 : twice_area < 0;
    if (twice_area == 0 || (batch.faces == Faces::kFrontOnly && !front)) continue;
    if (twice_area < 0) {
      std::swap(b, c);
      twice_area = -twice_area;
    }
    auto relative = [&](const ProjectedVertex& v) {
      return Corner{v.x - x0 * kSubPixels, v.y - y0 * kSubPixels, v.inverse_z};
    };
    const Corner ra = relative(a), rb = relative(*b), rc = relative(*c);
    const Edge edges[3] = {EdgeOf(ra, rb), EdgeOf(rb, rc), EdgeOf(rc, ra)};
    const Plane plane = PlaneOf(ra, rb, rc, twice_area);
    const std::int32_t id = batch.ids.empty() ? batch.first_id + static_cast<std::int32_t>(t) : batch.ids[t];
    touched = {std::min(touched.x0, x0), std::min(touched.y0, y0), std::max(touched.x1, x1),
               std::max(touched.y1, y1)};
    for (int i = 0; i <= x1 - x0; ++i) {
      float inverse_z = plane.c + plane.right * static_cast<float>(i);
      for (int j = 0; j <= y1 - y0; ++j, inverse_z += plane.down) {
        const bool inside = std::all_of(std::begin(edges), std::end(edges),
                                        [&](const Edge& e) { return e.c + e.right * i + e.down * j >= 0; });
        const std::ptrdiff_t at = (y0 + j) * target.stride + x0 + i;
        if (!inside || !(inverse_z > target.inverse_z[at])) continue;
        target.inverse_z[at] = inverse_z;
        if (target.triangle != nullptr) target.triangle[at] = id;
      }
    }
  }
}

}  // namespace mixstage::raster
