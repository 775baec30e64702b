// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "server/raster/raster_lens.h"
#include "server/raster/rasteriser.h"
#include "server/raster/scan_picture.h"
#include "server/raster/split_triangle.h"

namespace mixstage::raster {

// The back end without a GPU: corners through the lens, small triangles scanned, the rest split first. One
// thread.
class CpuRasteriser final : public Rasteriser {
 public:
  CpuRasteriser(const PinholeCamera& camera, const RasterConfig& config);  // checked by CreateRasteriser

  void Begin(const PictureGrid& grid) override;
  void Draw(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
            Faces faces) override;
  void DrawDepth(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, Faces faces) override;
  const VisibilityBuffer& Finish() override;

 private:
  void Scan(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id, Faces faces,
            const ScanTarget& target);
  void ScanSplit(const ScanBatch& like, const ScanTarget& target);

  const PinholeCamera camera_;
  const RasterLens picture_lens_;
  RasterLens lens_;  // on the grid
  ScanPicture picture_;
  // Scratch, kept for its memory.
  std::vector<ProjectedVertex> projected_;
  std::vector<std::uint32_t> needs_split_, never_split_;
  SplitTriangles split_;
};

}  // namespace mixstage::raster
