// SPDX-License-Identifier: Apache-2.0
#include "server/raster/cpu_rasteriser.h"

#include <algorithm>

#include "proto/base/check.h"

namespace mixstage::raster {
namespace {

// Split triangles are scanned whenever so many wait: bounds the memory of a wall that fills the view.
constexpr std::size_t kSplitBatch = 4096;

Affine34 RowsOf(const Eigen::Affine3d& T) {
  Affine34 rows;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) rows.m[r][c] = static_cast<float>(T.matrix()(r, c));
  }
  return rows;
}

cv::Rect RectOf(const TouchedBox& box) {
  if (box.x1 < box.x0 || box.y1 < box.y0) return {};
  return {box.x0, box.y0, box.x1 - box.x0 + 1, box.y1 - box.y0 + 1};
}

}  // namespace

CpuRasteriser::CpuRasteriser(const PinholeCamera& camera, const RasterConfig& config)
    : camera_(camera), picture_lens_(RasterLens::Of(camera, config.near_m)) {}

void CpuRasteriser::Begin(const PictureGrid& grid) {
  Clear();
  const PinholeCamera grid_camera = grid.CameraOf(camera_);
  lens_ = picture_lens_.OnGrid(grid_camera, grid.scale);
  grid_width_ = grid_camera.width;
  grid_height_ = grid_camera.height;
  if (inverse_z_.cols < grid_width_ + kRowPadding || inverse_z_.rows < grid_height_) {
    const int width = std::max(inverse_z_.cols, grid_width_ + kRowPadding);
    const int height = std::max(inverse_z_.rows, grid_height_);
    inverse_z_ = cv::Mat1f(height, width, 0.0f);
    depth_m_ = cv::Mat1f(height, width, 0.0f);
    triangle_ = cv::Mat1i(height, width, -1);
  }
  const cv::Rect whole(0, 0, grid_width_, grid_height_);
  buffer_ = {depth_m_(whole), triangle_(whole), {}};
}

void CpuRasteriser::Clear() {
  // Vectors may have written back old values right of the box, never new ones.
  const cv::Rect touched = RectOf(touched_);
  if (!touched.empty()) {
    inverse_z_(touched).setTo(0.0f);
    depth_m_(touched).setTo(0.0f);
    triangle_(touched).setTo(-1);
  }
  touched_ = {};
}

void CpuRasteriser::Draw(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
                         Faces faces) {
  MIX_CHECK(first_id >= 0);
  Scan(mesh, T_camera_object, first_id, faces, triangle_.ptr<std::int32_t>());
}

void CpuRasteriser::DrawDepth(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object,
                              Faces faces) {
  Scan(mesh, T_camera_object, 0, faces, nullptr);
}

void CpuRasteriser::Scan(const TriangleMeshView& mesh, const Eigen::Affine3d& T_camera_object, int first_id,
                         Faces faces, std::int32_t* triangle) {
  MIX_CHECK(grid_width_ > 0);  // Begin comes first
  MIX_CHECK(mesh.indices.size() % 3 == 0 && mesh.positions.size() < (1u << 29));
  if (mesh.indices.empty()) return;
  std::uint32_t largest = 0;
  for (const std::uint32_t index : mesh.indices) largest = std::max(largest, index);
  MIX_CHECK(largest < mesh.positions.size());

  const Affine34 T = RowsOf(T_camera_object);
  projected_.resize(mesh.positions.size());
  ProjectVertices(lens_, T, mesh.positions, projected_);
  const ScanTarget target{
      inverse_z_.ptr<float>(), triangle,        static_cast<std::ptrdiff_t>(inverse_z_.step1()), 0, 0,
      grid_width_ - 1,         grid_height_ - 1};
  ScanBatch batch;
  batch.vertices = projected_;
  batch.indices = mesh.indices;
  batch.first_id = first_id;
  batch.faces = faces;
  batch.mirrored = T_camera_object.linear().determinant() < 0;
  batch.max_edge = lens_.max_edge;
  needs_split_.clear();
  ScanTriangles(batch, target, needs_split_, touched_);

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
  if (!split_.ids.empty()) ScanTriangles(batch, target, never_split_, touched_);
  MIX_CHECK(never_split_.empty());
  split_.Clear();
}

const VisibilityBuffer& CpuRasteriser::Finish() {
  buffer_.touched = RectOf(touched_);
  const cv::Rect& r = buffer_.touched;
  for (int y = r.y; y < r.y + r.height; ++y) {
    InverseToDepth(inverse_z_.ptr<float>(y) + r.x, depth_m_.ptr<float>(y) + r.x,
                   static_cast<std::size_t>(r.width));
  }
  return buffer_;
}

}  // namespace mixstage::raster

namespace mixstage {

PinholeCamera PictureGrid::CameraOf(const PinholeCamera& picture) const {
  MIX_CHECK(scale == 1 || scale == 2 || scale == 4);
  const cv::Rect whole(0, 0, picture.width, picture.height);
  const cv::Rect region = region_px.empty() ? whole : region_px;
  MIX_CHECK((region & whole) == region);
  PinholeCamera camera = picture;
  camera.width = region.width * scale;
  camera.height = region.height * scale;
  camera.fx *= scale;
  camera.fy *= scale;
  camera.cx = scale * (picture.cx - region.x + 0.5) - 0.5;
  camera.cy = scale * (picture.cy - region.y + 0.5) - 0.5;
  return camera;
}

Result<std::unique_ptr<Rasteriser>> CreateRasteriser(RasterBackend backend, const PinholeCamera& camera,
                                                     const RasterConfig& config) {
  if (auto ok = camera.Validate(); !ok)
    return Within("camera", {ErrorCode::kInvalidConfig, ok.error().message});
  if (!(config.near_m >= 1e-4 && config.near_m <= 10)) {
    return Fail(ErrorCode::kInvalidConfig, "near_m is outside 0.0001..10 m");
  }
  if (backend != RasterBackend::kCpu) return Fail(ErrorCode::kInvalidConfig, "raster back end is not cpu");
  return std::make_unique<raster::CpuRasteriser>(camera, config);
}

}  // namespace mixstage
