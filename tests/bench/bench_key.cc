// SPDX-License-Identifier: Apache-2.0
//
// The key on whole frames of 1024x768: an actor of a tenth of the picture, his shadow, 40 ms old depth.
#include <benchmark/benchmark.h>

#include <opencv2/core.hpp>

#include "server/segmentation/actor_surface.h"
#include "server/segmentation/key.h"
#include "tests/server/segmentation/flat_room.h"

namespace mixstage {
namespace {

struct Scene {
  Scene() : room(1024, 768, 4.0f), model(room.Learn(5)), label(768, 1024), alpha(768, 1024) {
    cv::setNumThreads(1);
    room.Shoot();
    room.Darken({300, 560, 300, 120}, 0.8f);
    room.PaintColor({420, 160, 160, 480}, 30, 32, 40);
    room.PaintDepth({410, 160, 160, 480}, 2.8f);
  }
  FlatRoom room;
  BackgroundModel model;
  Key key = Key::Create({}).value();
  cv::Mat1b label, alpha;
};

void BM_HalfRgb(benchmark::State& state) {
  YuvImage image;
  image.Create(1024, 768, ChromaLayout::k420);
  for (cv::Mat1b* plane : {&image.y, &image.cb, &image.cr}) plane->setTo(100);
  HalfPicture half;
  for (auto _ : state) HalfRgb(image, &half);
}
BENCHMARK(BM_HalfRgb)->Unit(benchmark::kMillisecond);

void BM_Key(benchmark::State& state) {
  Scene s;
  const auto luma = s.room.Luma();
  for (auto _ : state)
    s.key.Run(s.model, luma, s.room.picture, s.room.Depth(), 0.04f, View(s.label), View(s.alpha));
}
BENCHMARK(BM_Key)->Unit(benchmark::kMillisecond);

void BM_ActorSurface(benchmark::State& state) {
  Scene s;
  s.key.Run(s.model, s.room.Luma(), s.room.picture, s.room.Depth(), 0.04f, View(s.label), View(s.alpha));
  ActorSurface surface = ActorSurface::Create({}).value();
  for (auto _ : state) surface.Run(s.key.half_mask(), s.room.Depth(), s.model);
}
BENCHMARK(BM_ActorSurface)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage

BENCHMARK_MAIN();
