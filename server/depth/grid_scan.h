// SPDX-License-Identifier: Apache-2.0
//
// The regular grid's way through the rasteriser: its corners move along fixed rays, and a cell's two
// triangles are scanned together. No index, no gather, no bins. The scalar code is the specification; the
// vector code gives the same bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/raster/projected_vertex.h"
#include "server/raster/raster_lens.h"

namespace mixstage::depth {

// Corners as one array a field. Capacity is a multiple of 8 beyond count, for whole vectors.
struct CornerRays {
  std::vector<float> x, y, z;  // p_color = depth_z * (x, y, z) + t
  void Resize(std::size_t count);
};
struct GridCorners {
  std::vector<std::int32_t> x, y;  // as in raster::ProjectedVertex
  std::vector<float> inverse_z;
  std::vector<std::int32_t> outcode;
  void Resize(std::size_t count);
};

// Projects corners first .. first + count - 1. Corners with depth_z = 0 get an outcode != 0 or a place that
// no cell uses. Vector code may write up to 7 corners more.
void ProjectCorners(const raster::RasterLens& lens, const float t[3], const CornerRays& rays,
                    const float* depth_z, std::size_t first, std::size_t count, GridCorners& out);
void ProjectCornersScalar(const raster::RasterLens& lens, const float t[3], const CornerRays& rays,
                          const float* depth_z, std::size_t first, std::size_t count, GridCorners& out);

// Cell i has the corners at [i] of top left, top right, bottom left, bottom right and the parts cells[i]
// (enum Cell).
struct CellRun {
  struct Corner {
    const std::int32_t* x;
    const std::int32_t* y;
    const float* inverse_z;
    const std::int32_t* outcode;
  };
  Corner corners[4];
  const std::uint8_t* cells;
  std::size_t count;
};

// Draws the parts that face the colour camera (seen from behind, a surface measured from the depth camera is
// none), nearest wins; the target's triangle ids are not used. Cells wider or higher than kMaxEdgePx are left
// out. Reads up to 7 cells beyond count; writes up to kRowPadding - 1 elements right of x1.
void ScanCells(const CellRun& run, const raster::ScanTarget& target);
void ScanCellsScalar(const CellRun& run, const raster::ScanTarget& target);

// Same coverage, but empties pixels (0) that hold something farther.
void EraseBehindCells(const CellRun& run, const raster::ScanTarget& target);
void EraseBehindCellsScalar(const CellRun& run, const raster::ScanTarget& target);

// depth_m = 1 / inverse_z (0 for 0), and inverse_z = 0 for the next picture, in one pass.
void TakeDepth(float* inverse_z, float* depth_m, std::size_t count);

}  // namespace mixstage::depth
