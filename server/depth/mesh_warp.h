// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "proto/geometry/rig.h"
#include "server/depth/egl_grid_scan.h"
#include "server/depth/grid_scan.h"
#include "server/depth/surface_cut.h"
#include "server/raster/raster_lens.h"
#include "server/raster/render_device.h"

namespace mixstage::depth {

// The mesh of DepthWarp: rays of the depth grid in the colour camera's frame, corners moved along them, cells
// scanned.
class MeshWarp {
 public:
  MeshWarp(const Rig& rig, DepthSignal signal, const SurfaceCutConfig& cut, double near_m);
  // From now on cells are scanned by the device, and here only while it cannot. Fails when it never can.
  Status Use(const RenderDevice& device);

  // Sizes are the rig's.
  void Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> amplitude,
           ImageView<float> depth_m);

  [[nodiscard]] const SurfaceCut& cut() const { return cut_; }

 private:
  void ProjectRow(int y);
  void DrawSurface();
  // Fills torn_; how many there are.
  std::size_t PlaceTornCells();
  void EraseBehindEdges();
  // Corners placed here, cells scanned there. False when the GPU cannot (now).
  bool DrawOnGpu(ImageView<float> depth_m);

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
  std::optional<EglGridScan> egl_;  // nothing: the cpu back end
  bool reported_ = false;
};

}  // namespace mixstage::depth
