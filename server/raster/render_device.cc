// SPDX-License-Identifier: Apache-2.0
#include "server/raster/render_device.h"

#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "proto/base/log.h"

namespace mixstage {
namespace {

// A driver may be there and draw nonsense: one triangle must come out as the cpu back end draws it.
Status DrawsAsCpu(const std::shared_ptr<gl::Gpu>& gpu) {
  const PinholeCamera camera{
      .width = 64, .height = 48, .fx = 60, .fy = 60, .cx = 31.5, .cy = 23.5, .k1 = -0.1};
  const std::vector<Eigen::Vector3f> corners = {{-0.4f, -0.3f, 1}, {0.1f, 0.35f, 1.5f}, {0.9f, -0.2f, 2}};
  const std::vector<std::uint32_t> indices = {0, 1, 2};
  cv::Mat1f depth_m[2];
  for (const RasterBackend backend : {RasterBackend::kCpu, RasterBackend::kEgl}) {
    auto rasteriser = CreateRasteriser(backend, camera, {}, gpu);
    if (!rasteriser) return tl::unexpected(rasteriser.error());
    (*rasteriser)->Begin({});
    (*rasteriser)->Draw({corners, indices}, Eigen::Affine3d::Identity(), 0, Faces::kFrontOnly);
    (*rasteriser)->Finish().depth_m.copyTo(depth_m[backend == RasterBackend::kEgl]);
  }
  // Pixels whose centre an edge hits may differ.
  const int wrong = cv::countNonZero(cv::abs(depth_m[0] - depth_m[1]) > 1e-3);
  if (cv::countNonZero(depth_m[0]) > 100 && wrong <= 8) return {};
  return Fail(ErrorCode::kInternal, "the GPU's driver draws a test triangle wrong");
}

}  // namespace

Result<RendererChoice> ParseRenderer(const std::string& name) {
  for (const RendererChoice choice : {RendererChoice::kAuto, RendererChoice::kCpu, RendererChoice::kEgl}) {
    if (name == RendererName(choice)) return choice;
  }
  return Fail(ErrorCode::kInvalidConfig, "renderer \"" + name + "\" is none of auto, cpu, egl");
}

const char* RendererName(RendererChoice choice) {
  switch (choice) {
    case RendererChoice::kAuto:
      return "auto";
    case RendererChoice::kCpu:
      return "cpu";
    case RendererChoice::kEgl:
      return "egl";
  }
  return "";
}

std::string RenderDevice::Name() const {
  return backend == RasterBackend::kCpu ? "cpu" : "egl (" + gpu->info().renderer + ")";
}

Result<RenderDevice> ChooseBackend(RendererChoice choice) {
  if (choice == RendererChoice::kCpu) return RenderDevice{};
  auto gpu = gl::Gpu::Create(choice == RendererChoice::kEgl ? gl::Devices::kAny : gl::Devices::kGpusOnly);
  if (choice == RendererChoice::kEgl) {
    if (!gpu) return tl::unexpected(gpu.error());
    return RenderDevice{RasterBackend::kEgl, std::move(*gpu)};
  }
  if (!gpu) return RenderDevice{};
  if (auto ok = DrawsAsCpu(*gpu); !ok) {
    spdlog::warn("renderer event=gpu_refused device=\"{}\" reason=\"{}\"", (*gpu)->info().renderer,
                 ok.error().message);
    return RenderDevice{};
  }
  return RenderDevice{RasterBackend::kEgl, std::move(*gpu)};
}

}  // namespace mixstage
