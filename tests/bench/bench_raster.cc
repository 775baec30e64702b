// SPDX-License-Identifier: Apache-2.0
//
// Visibility of triangle meshes, core-ms a picture: cpu on one thread, egl over all threads of the process (a
// software driver's too).
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "server/gl/gpu.h"
#include "server/raster/rasteriser.h"
#include "server/raster/scan.h"

namespace mixstage {
namespace {

PinholeCamera Camera() {
  return {.width = 1024,
          .height = 768,
          .fx = 1093.7,
          .fy = 1093.7,
          .cx = 521.5,
          .cy = 375.5,
          .k1 = -0.12,
          .k2 = 0.06};
}

struct Mesh {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::uint32_t> indices;
};

// A sphere of rings x 2 rings quads around (0, 0, distance).
Mesh Sphere(int rings, float radius_m, float distance_m) {
  Mesh mesh;
  const int columns = 2 * rings;
  for (int j = 0; j <= rings; ++j) {
    for (int i = 0; i <= columns; ++i) {
      const double a = std::numbers::pi * j / rings, b = 2 * std::numbers::pi * i / columns;
      mesh.positions.emplace_back(radius_m * static_cast<float>(std::sin(a) * std::cos(b)),
                                  radius_m * static_cast<float>(std::cos(a)),
                                  distance_m + radius_m * static_cast<float>(std::sin(a) * std::sin(b)));
    }
  }
  for (int j = 0; j < rings; ++j) {
    for (int i = 0; i < columns; ++i) {
      const auto a = static_cast<std::uint32_t>(j * (columns + 1) + i);
      const std::uint32_t c = a + static_cast<std::uint32_t>(columns) + 1;
      for (const std::uint32_t k : {a, a + 1, c, a + 1, c + 1, c}) mesh.indices.push_back(k);
    }
  }
  return mesh;
}

void Draw(benchmark::State& state, RasterBackend backend, const Mesh& mesh, const PictureGrid& grid,
          Faces faces) {
  auto made = CreateRasteriser(backend, Camera(), {});
  if (!made) return state.SkipWithError(made.error().message.c_str());
  const auto rasteriser = std::move(*made);
  for (auto _ : state) {
    rasteriser->Begin(grid);
    rasteriser->Draw({mesh.positions, mesh.indices}, Eigen::Affine3d::Identity(), 0, faces);
    benchmark::DoNotOptimize(rasteriser->Finish().depth_m.data);
  }
  const cv::Mat1f& depth_m = rasteriser->Finish().depth_m;
  state.counters["triangles"] = static_cast<double>(mesh.indices.size()) / 3;
  state.counters["share"] = cv::countNonZero(depth_m) / static_cast<double>(depth_m.total());
}

// 15 % of the picture.
void RasterSphere(benchmark::State& state, RasterBackend backend) {
  Draw(state, backend, Sphere(static_cast<int>(state.range(0)), 0.5f, 2.9f), {},
       static_cast<Faces>(state.range(1)));
}
BENCHMARK_CAPTURE(RasterSphere, cpu, RasterBackend::kCpu)
    ->Args({71, 1})
    ->Args({71, 2})
    ->Args({112, 1})
    ->Args({112, 2})
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(RasterSphere, egl, RasterBackend::kEgl)
    ->Args({71, 1})
    ->Args({112, 2})
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

void RasterSphereFourTimesFiner(benchmark::State& state, RasterBackend backend) {
  Draw(state, backend, Sphere(71, 0.5f, 2.9f), {.scale = 4, .region_px = {300, 150, 440, 440}},
       Faces::kFrontOnly);
}
BENCHMARK_CAPTURE(RasterSphereFourTimesFiner, cpu, RasterBackend::kCpu)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(RasterSphereFourTimesFiner, egl, RasterBackend::kEgl)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

// The inside of a sphere around the camera: a room of 150k triangles, most of them outside the view.
void RasterRoomAround(benchmark::State& state, RasterBackend backend) {
  Draw(state, backend, Sphere(194, 4.0f, 0.0f), {}, Faces::kBoth);
}
BENCHMARK_CAPTURE(RasterRoomAround, cpu, RasterBackend::kCpu)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(RasterRoomAround, egl, RasterBackend::kEgl)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

// Two triangles that fill the view: everything is splitting.
void RasterWall(benchmark::State& state, RasterBackend backend) {
  Mesh wall;
  wall.positions = {{-9, -7, 4}, {9, -7, 5}, {9, 7, 4}, {-9, 7, 3}};
  wall.indices = {0, 1, 2, 0, 2, 3};
  Draw(state, backend, wall, {}, Faces::kBoth);
}
BENCHMARK_CAPTURE(RasterWall, cpu, RasterBackend::kCpu)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(RasterWall, egl, RasterBackend::kEgl)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

// From a lost context to the first picture of the new one.
void RecoverFromLoss(benchmark::State& state) {
  auto gpu = gl::Gpu::Create();
  if (!gpu) return state.SkipWithError(gpu.error().message.c_str());
  auto rasteriser = *CreateRasteriser(RasterBackend::kEgl, Camera(), {}, *gpu);
  const Mesh mesh = Sphere(71, 0.5f, 2.9f);
  for (auto _ : state) {
    const std::uint64_t before = (*gpu)->generation();
    (*gpu)->LoseForTest();
    while ((*gpu)->generation() == before) {
      rasteriser->Begin({});
      rasteriser->Draw({mesh.positions, mesh.indices}, Eigen::Affine3d::Identity(), 0, Faces::kBoth);
      benchmark::DoNotOptimize(rasteriser->Finish().depth_m.data);
    }
  }
}
BENCHMARK(RecoverFromLoss)->Iterations(5)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage
BENCHMARK_MAIN();
