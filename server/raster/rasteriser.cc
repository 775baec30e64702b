// SPDX-License-Identifier: Apache-2.0
#include "server/raster/rasteriser.h"

#include <algorithm>
#include <utility>

#include "proto/base/check.h"
#include "server/raster/cpu_rasteriser.h"
#include "server/raster/egl_rasteriser.h"

namespace mixstage {

void TriangleMeshView::Check() const {
  MIX_CHECK(indices.size() % 3 == 0 && positions.size() < (1u << 29));
  std::uint32_t largest = 0;
  for (const std::uint32_t index : indices) largest = std::max(largest, index);
  MIX_CHECK(indices.empty() || largest < positions.size());
}

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
                                                     const RasterConfig& config,
                                                     std::shared_ptr<gl::Gpu> gpu) {
  if (auto ok = camera.Validate(); !ok)
    return Within("camera", {ErrorCode::kInvalidConfig, ok.error().message});
  if (!(config.near_m >= 1e-4 && config.near_m <= 10)) {
    return Fail(ErrorCode::kInvalidConfig, "near_m is outside 0.0001..10 m");
  }
  if (backend == RasterBackend::kCpu) return std::make_unique<raster::CpuRasteriser>(camera, config);
  if (!gpu) {
    auto own = gl::Gpu::Create();
    if (!own) return tl::unexpected(own.error());
    gpu = std::move(*own);
  }
  auto egl = raster::EglRasteriser::Create(camera, config, std::move(gpu));
  if (!egl) return tl::unexpected(egl.error());
  return std::make_unique<raster::EglRasteriser>(std::move(*egl));
}

}  // namespace mixstage
