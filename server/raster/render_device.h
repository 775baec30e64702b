// SPDX-License-Identifier: Apache-2.0
//
// What passes draw with, chosen once for a show.
#pragma once

#include <memory>
#include <string>

#include "server/gl/gpu.h"
#include "server/raster/rasteriser.h"

namespace mixstage {

// studio.yaml's and --renderer's word.
enum class RendererChoice {
  kAuto = 1,  // egl where there is a GPU that draws as cpu does; cpu where EGL is missing or software
  kCpu,
  kEgl,  // also on a software driver
};
// "auto", "cpu", "egl"; fails (kInvalidConfig) on anything else.
Result<RendererChoice> ParseRenderer(const std::string& name);
[[nodiscard]] const char* RendererName(RendererChoice choice);

struct RenderDevice {
  RasterBackend backend = RasterBackend::kCpu;
  std::shared_ptr<gl::Gpu> gpu;  // with kEgl; passes share it
  // For people: "cpu", "egl (llvmpipe ...)".
  [[nodiscard]] std::string Name() const;
};

// Fails (kUnavailable, what to install said) with kEgl alone.
Result<RenderDevice> ChooseBackend(RendererChoice choice);

}  // namespace mixstage
