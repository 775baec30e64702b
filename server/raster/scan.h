// SPDX-License-Identifier: Apache-2.0
//
// Small projected triangles into depth and id. The scalar code is the specification; the vector code gives
// the same bits.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "server/raster/projected_vertex.h"
#include "server/raster/rasteriser.h"

namespace mixstage::raster {

// Triangle i has corners vertices[indices[3 i + 0..2]] and id ids[i], or first_id + i where ids is empty.
struct ScanBatch {
  std::span<const ProjectedVertex> vertices;
  std::span<const std::uint32_t> indices;
  std::span<const std::int32_t> ids;
  std::int32_t first_id = 0;
  Faces faces = Faces::kBoth;
  // Front faces run clockwise on the screen (an object placed by a mirroring transform).
  bool mirrored = false;
  std::int32_t max_edge = kMaxEdgePx * kSubPixels;  // sub-pixels, at most kMaxEdgePx
};

// Draws the triangles that are visible and small; appends the numbers of those that must be split or clipped
// first (a corner without pixel, an edge beyond max_edge) to needs_split. touched grows by what was scanned.
void ScanTriangles(const ScanBatch& batch, const ScanTarget& target, std::vector<std::uint32_t>& needs_split,
                   TouchedBox& touched);
void ScanTrianglesScalar(const ScanBatch& batch, const ScanTarget& target,
                         std::vector<std::uint32_t>& needs_split, TouchedBox& touched);

// depth_m[i] = 1 / inverse_z[i], 0 for 0.
void InverseToDepth(const float* inverse_z, float* depth_m, std::size_t count);

}  // namespace mixstage::raster
