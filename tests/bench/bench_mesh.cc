// SPDX-License-Identifier: Apache-2.0
//
// The actor's mesh for viewers: a man with a round body who fills a third of a 1024 x 768 picture, seen
// through a distorting lens with a ToF camera's noise; about 16 thousand vertices. One thread that waits for
// nothing: its CPU time is core-ms. The counters say what came out.
#include <benchmark/benchmark.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "proto/codec/jpeg.h"
#include "server/delivery/draco_mesh.h"
#include "server/segmentation/actor_mesh.h"

namespace mixstage {
namespace {

PinholeCamera Camera() {
  PinholeCamera camera;
  camera.width = 1024, camera.height = 768;
  camera.fx = camera.fy = 1094, camera.cx = 521.5, camera.cy = 375.5;
  camera.k1 = -0.12, camera.k2 = 0.06;
  return camera;
}

struct Actor {
  Actor() {
    constexpr double kHalfWidth = 212, kHalfHeight = 366;
    cv::Mat1f noise(384, 512);
    cv::randn(noise, 0, 0.1);
    cv::GaussianBlur(noise, noise, {}, 5);  // 6 mm are left, as smooth as ActorSurface's
    for (int y = 0; y < alpha.rows; ++y) {
      for (int x = 0; x < alpha.cols; ++x) {
        const double radius = std::hypot((x - 512) / kHalfWidth, (y - 390) / kHalfHeight);
        alpha(y, x) = cv::saturate_cast<std::uint8_t>(255 * ((1 - radius) * kHalfWidth + 0.5));
        if (radius < 1) {
          depth_m(y / 2, x / 2) =
              static_cast<float>(3.0 - 0.2 * std::sqrt(1 - radius * radius)) + noise(y / 2, x / 2);
        }
      }
    }
    picture.Create(1024, 768, ChromaLayout::k420);
    cv::randn(picture.y, 120, 40);
    cv::GaussianBlur(picture.y, picture.y, {}, 1.5);
    picture.cb.setTo(120);
    picture.cr.setTo(140);
  }
  cv::Mat1b alpha = cv::Mat1b(768, 1024, std::uint8_t{0});
  cv::Mat1f depth_m = cv::Mat1f(384, 512, 0.0f);
  YuvImage picture;
};

const PictureMesh& Run(ActorMesher& mesher, const Actor& actor) {
  return mesher.Run(View(actor.alpha), View(actor.depth_m), RigidTransform::Identity());
}

void MakeActorMesh(benchmark::State& state) {
  const Actor actor;
  auto mesher = ActorMesher::Create({}, Camera()).value();
  std::size_t vertices = 0;
  for (auto unused : state) vertices = Run(mesher, actor).positions.size();
  state.counters["vertices"] = static_cast<double>(vertices);
}
BENCHMARK(MakeActorMesh)->Unit(benchmark::kMillisecond);

void EncodeActorMesh(benchmark::State& state) {
  const Actor actor;
  auto mesher = ActorMesher::Create({}, Camera()).value();
  const PictureMesh& mesh = Run(mesher, actor);
  std::size_t bytes = 0;
  for (auto unused : state) {
    const auto draco =
        EncodeDraco({.positions = mesh.positions, .uvs = mesh.uvs, .indices = mesh.indices}, {});
    MIX_CHECK(draco.has_value());
    bytes = draco->size();
  }
  state.counters["bytes"] = static_cast<double>(bytes);
  state.counters["triangles"] = static_cast<double>(mesh.indices.size() / 3);
}
BENCHMARK(EncodeActorMesh)->Unit(benchmark::kMillisecond);

void EncodeActorTexture(benchmark::State& state) {
  const Actor actor;
  auto mesher = ActorMesher::Create({}, Camera()).value();
  const PictureMesh& mesh = Run(mesher, actor);
  JpegEncoder jpeg;
  std::vector<std::uint8_t> bytes;
  for (auto unused : state) MIX_CHECK(jpeg.Encode(Crop(actor.picture, mesh.crop), 75, bytes).has_value());
  state.counters["bytes"] = static_cast<double>(bytes.size());
}
BENCHMARK(EncodeActorTexture)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage

BENCHMARK_MAIN();
