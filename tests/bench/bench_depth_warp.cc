// SPDX-License-Identifier: Apache-2.0
//
// The depth picture warped into the colour view, core-ms a picture (egl: over all threads of the process).
#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "server/depth/depth_warp.h"
#include "server/depth/surface_cut.h"

namespace mixstage {
namespace {

// A wall at 5 m, a floor 1.4 m below, a figure-like box at 3 m, 30 mm noise.
cv::Mat1w NoisyRoom(const DepthCamera& depth) {
  const cv::Mat2f rays = UnprojectionTable(depth.camera);
  cv::Mat1w raw(rays.size(), std::uint16_t{0});
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.03);
  for (int y = 0; y < raw.rows; ++y) {
    for (int x = 0; x < raw.cols; ++x) {
      const double rx = rays(y, x)[0], ry = rays(y, x)[1];
      if (!std::isfinite(rx)) continue;
      double z = 5;
      if (ry > 1e-3) z = std::min(z, 1.4 / ry);
      if (std::abs(3 * rx) < 0.3 && 3 * ry > -0.5 && 3 * ry < 1.2) z = 3;
      const double length = depth.measures == DepthMeasure::kRange ? std::sqrt(1 + rx * rx + ry * ry) : 1;
      raw(y, x) = static_cast<std::uint16_t>(std::lround((z + noise(random)) * length / depth.unit_m));
    }
  }
  return raw;
}

Rig TimeOfFlightRig() {
  Rig rig;
  rig.color = {.width = 1024,
               .height = 768,
               .fx = 1093.7,
               .fy = 1093.7,
               .cx = 521.5,
               .cy = 375.5,
               .k1 = -0.12,
               .k2 = 0.06};
  rig.depth = DepthCamera{.camera = {.width = 176,
                                     .height = 144,
                                     .fx = 220.6,
                                     .fy = 220.6,
                                     .cx = 90.5,
                                     .cy = 69,
                                     .k1 = -0.25,
                                     .k2 = 0.1},
                          .measures = DepthMeasure::kRange,
                          .unit_m = 0.00025,
                          .unambiguous_range_m = 7.4948,
                          .range_error = {}};
  rig.T_color_depth.translation() = Eigen::Vector3d(0.0712, -0.0187, 0.0064);
  return rig;
}

Rig LargeRig() {
  Rig rig = TimeOfFlightRig();
  rig.depth = DepthCamera{
      .camera = {.width = 640, .height = 576, .fx = 505, .fy = 505, .cx = 322, .cy = 288, .k1 = -0.1},
      .measures = DepthMeasure::kZ,
      .unit_m = 0.001,
      .unambiguous_range_m = {},
      .range_error = {}};
  return rig;
}

void Warp(benchmark::State& state, const Rig& rig, RendererChoice choice) {
  const auto device = ChooseBackend(choice);
  if (!device) return state.SkipWithError(device.error().message.c_str());
  auto warp = *DepthWarp::Create(rig, {}, *device);
  const cv::Mat1w raw = NoisyRoom(*rig.depth);
  cv::Mat1f depth_m(rig.color.height, rig.color.width);
  for (auto _ : state) {
    benchmark::DoNotOptimize(warp.Run(View(raw), {}, View(depth_m)).has_value());
  }
  state.counters["known"] = cv::countNonZero(depth_m) / static_cast<double>(depth_m.total());
}
void WarpTimeOfFlight(benchmark::State& state, RendererChoice choice) {
  Warp(state, TimeOfFlightRig(), choice);
}
BENCHMARK_CAPTURE(WarpTimeOfFlight, cpu, RendererChoice::kCpu)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(WarpTimeOfFlight, egl, RendererChoice::kEgl)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
void WarpLarge(benchmark::State& state, RendererChoice choice) { Warp(state, LargeRig(), choice); }
BENCHMARK_CAPTURE(WarpLarge, cpu, RendererChoice::kCpu)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(WarpLarge, egl, RendererChoice::kEgl)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

// The part of it before the rasteriser.
void CutTimeOfFlight(benchmark::State& state) {
  const Rig rig = TimeOfFlightRig();
  const DepthSignal signal = *DepthSignal::Create(*rig.depth, 20);
  depth::SurfaceCut cut(signal, {});
  const cv::Mat1w raw = NoisyRoom(*rig.depth);
  for (auto _ : state) {
    cut.Run(signal, View(raw), {});
    benchmark::DoNotOptimize(cut.cells().data());
  }
}
BENCHMARK(CutTimeOfFlight)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage
BENCHMARK_MAIN();
