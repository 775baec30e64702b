// SPDX-License-Identifier: Apache-2.0
#include "server/raster/cpu_rasteriser.h"

#include "proto/base/check.h"

namespace mixstage::raster {
namespace {

// Split triangles are scanned whenever so many wait: bounds the memory of a wall that fills the view.
constexpr std::size_t kSplitBatch = 4096;

}  // namespace

CpuRasteriser::CpuRasteriser(const PinholeCamera& camera, const RasterConfig& config)
    : camera_(camera), picture_lens_(RasterLens::Of(camera, config.near_m)) {}

void CpuRasteriser::Begin(const PictureGrid& grid) {
  const PinholeCamera grid_camera = grid.CameraOf(camera_);
  lens_ = picture_lens_.OnGrid(grid_camera, grid.scale);
  lens_.half_space = grid.half_space;
  picture_.Begin(grid_camera.width, grid_camera.height);
}

void CpuRasteriser::Draw(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
                         Faces faces) {
  MIX_CHECK(first_id >= 0);
  Scan(mesh, T_camera_object, first_id, faces, picture_.Target());
}

void CpuRasteriser::DrawDepth(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object,
                              Faces faces) {
  Scan(mesh, T_camera_object, 0, faces, picture_.DepthTarget());
}

void CpuRasteriser::Scan(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
                         Faces faces, const ScanTarget& target) {
  mesh.Check();
  if (mesh.indices.empty()) return;
  const Affine34 T = Affine34::Of(T_camera_object);
  projected_.resize(mesh.positions.size());
  ProjectVertices(lens_, T, mesh.positions, projected_);
  lens_.CutOff(T, mesh.positions, projected_);
  ScanBatch batch;
  batch.vertices = projected_;
  batch.indices = mesh.indices;
  batch.first_id = first_id;
  batch.faces = faces;
  batch.mirrored = T_camera_object.linear().determinant() < 0;
  batch.max_edge = lens_.max_edge;
  needs_split_.clear();
  ScanTriangles(batch, target, needs_split_, picture_.touched());

  for (const std::uint32_t t : needs_split_) {
    CameraCorner corners[3];
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t index = mesh.indices[3 * std::size_t{t} + k];
      corners[k] = {T * mesh.positions[index], projected_[index]};
    }
    SplitTriangle(lens_, corners[0], corners[1], corners[2], first_id + static_cast<std::int32_t>(t), target,
                  split_);
    if (split_.ids.size() >= kSplitBatch) ScanSplit(batch, target);
  }
  ScanSplit(batch, target);
}

void CpuRasteriser::ScanSplit(const ScanBatch& like, const ScanTarget& target) {
  ScanBatch batch = like;
  batch.vertices = split_.vertices;
  batch.indices = split_.indices;
  batch.ids = split_.ids;
  if (!split_.ids.empty()) ScanTriangles(batch, target, never_split_, picture_.touched());
  MIX_CHECK(never_split_.empty());
  split_.Clear();
}

const VisibilityBuffer& CpuRasteriser::Finish() { return picture_.Finish(); }

}  // namespace mixstage::raster
