// SPDX-License-Identifier: Apache-2.0
//
// The z-key on whole frames of 1024x768 as a show has them: an actor of a tenth of the picture, soft-edged,
// before and behind a few opaque objects with antialiased outlines that fill a quarter of it, and their thin
// shadow plane.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "server/composite/z_key.h"

namespace mixstage {
namespace {

constexpr int kWidth = 1024, kHeight = 768;

struct Stage {
  explicit Stage(ChromaLayout layout) {
    cv::setNumThreads(1);
    color.Create(kWidth, kHeight, layout);
    for (cv::Mat1b* plane : {&color.y, &color.cb, &color.cr}) {
      for (int y = 0; y < plane->rows; ++y) {
        for (int x = 0; x < plane->cols; ++x)
          (*plane)(y, x) = static_cast<std::uint8_t>(90 + (x * 7 + y * 13) % 60);
      }
    }
    room.revision = 1;
    room.depth_m = cv::Mat1f(kHeight, kWidth, 4.f);
    room.sigma_m = cv::Mat1f(kHeight, kWidth, 0.03f);
    alpha = cv::Mat1b::zeros(kHeight, kWidth);
    alpha(cv::Rect(420, 160, 160, 480)).setTo(255);
    cv::blur(alpha, alpha, {5, 5});
    actor_m = cv::Mat1f::zeros(kHeight / 2, kWidth / 2);
    actor_m(cv::Rect(210, 80, 80, 240)).setTo(2.5f);
    cg.bounds = {200, 200, 600, 500};
    cg.color = cv::Mat4f::zeros(cg.bounds.size());
    cg.depth_m = cv::Mat1f::zeros(cg.bounds.size());
    cg.drawing = 1;
    DrawDisc({150, 150}, 120, 2.f, 1);
    DrawDisc({320, 300}, 130, 3.f, 1);
    DrawDisc({480, 380}, 100, 2.2f, 0.3f);
  }
  void DrawDisc(cv::Point2f centre, float radius, float z, float opacity) {
    for (int y = 0; y < cg.bounds.height; ++y) {
      for (int x = 0; x < cg.bounds.width; ++x) {
        const float d = std::hypot(static_cast<float>(x) - centre.x, static_cast<float>(y) - centre.y);
        const float a = opacity * std::clamp(radius - d, 0.f, 1.f);
        if (a <= 0) continue;
        cg.color(y, x) = {a * 0.6f, a * 0.2f, a * 0.1f, a};
        cg.depth_m(y, x) = z;
      }
    }
  }
  void Run() {
    z_key.Run({.color = &color,
               .alpha = View(std::as_const(alpha)),
               .actor_depth_m = View(std::as_const(actor_m)),
               .room = &room,
               .cg = &cg},
              composite, depth_mm, cg_alpha);
  }

  YuvImage color, composite;
  RoomDepth room;
  CgLayer cg;
  cv::Mat1b alpha, cg_alpha;
  cv::Mat1f actor_m;
  cv::Mat1w depth_mm;
  ZKey z_key;
};

void BM_ZKey420(benchmark::State& state) {
  Stage stage(ChromaLayout::k420);
  for (auto _ : state) stage.Run();
}
BENCHMARK(BM_ZKey420)->Unit(benchmark::kMillisecond);

void BM_ZKey422(benchmark::State& state) {
  Stage stage(ChromaLayout::k422);
  for (auto _ : state) stage.Run();
}
BENCHMARK(BM_ZKey422)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage

BENCHMARK_MAIN();
