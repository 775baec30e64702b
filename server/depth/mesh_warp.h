// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "proto/geometry/rig.h"
#include "server/depth/grid_scan.h"
#include "server/depth/surface_cut.h"
#include "server/raster/raster_lens.h"

namespace mixstage::depth {

// The mesh of DepthWarp: rays of the depth grid in the colour camera's frame, corners moved along them, cells
// scanned.
class MeshWarp {
 public:
  MeshWarp(const Rig& rig, DepthSignal signal, const SurfaceCutConfig& cut, double near_m);

  // Sizes are the rig's.
  void Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> amplitude,
           ImageView<float> depth_m);

  [[nodiscard]] const SurfaceCut& cut() const { return cut_; }

 private:
  void DrawSurface();
  void EraseBehindEdges();

  const DepthSignal signal_;
  SurfaceCut cut_;
  raster::RasterLens lens_;
  float t_color_depth_[3] = {};
  CornerRays rays_;
  GridCorners corners_;
  std::vector<float> inverse_z_;  // of the colour picture, rows padded
  raster::ScanTarget target_;
  // Torn cells of a picture, closed: corners that are not on the nearest surface at its depth.
  struct TornCells {
    CornerRays rays[4];
    GridCorners corners[4];
    std::vector<float> depth_z[4];
    std::vector<float> inverse_z_scale;
    std::vector<std::uint8_t> cells;
  } torn_;
};

}  // namespace mixstage::depth
