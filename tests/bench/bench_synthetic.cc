// SPDX-License-Identifier: Apache-2.0
//
// Core time of the synthetic rig's pictures, mean over the whole loop: the share of the agent's frame that is
// not encoding.
#include <benchmark/benchmark.h>

#include "proto/base/check.h"
#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"

namespace mixstage {
namespace {

SyntheticScene Set() {
  auto scene = SyntheticScene::Create(SyntheticRig(), {});
  MIX_CHECK(scene.has_value());
  return std::move(*scene);
}

void BM_Create(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(Set());
}
BENCHMARK(BM_Create)->Unit(benchmark::kMillisecond)->Iterations(3)->MeasureProcessCPUTime()->UseRealTime();

void BM_RenderColorOverTheLoop(benchmark::State& state) {
  SyntheticScene scene = Set();
  YuvImage picture;
  int frame = 0;
  for (auto _ : state) scene.RenderColor(frame++ * (kLoop_s / 240), picture);
}
BENCHMARK(BM_RenderColorOverTheLoop)->Unit(benchmark::kMillisecond)->Iterations(720);

// The dearest frame: he stands nearest to the camera.
void BM_RenderColorFigureNear(benchmark::State& state) {
  SyntheticScene scene = Set();
  YuvImage picture;
  for (auto _ : state) scene.RenderColor(13.5, picture);
}
BENCHMARK(BM_RenderColorFigureNear)->Unit(benchmark::kMillisecond)->Iterations(200);

void BM_RenderTofOverTheLoop(benchmark::State& state) {
  SyntheticScene scene = Set();
  cv::Mat1w range, amplitude;
  int frame = 0;
  for (auto _ : state) scene.RenderTof(frame++ * (kLoop_s / 240), range, amplitude);
}
BENCHMARK(BM_RenderTofOverTheLoop)->Unit(benchmark::kMillisecond)->Iterations(720);

}  // namespace
}  // namespace mixstage

BENCHMARK_MAIN();
