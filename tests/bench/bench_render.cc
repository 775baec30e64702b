// SPDX-License-Identifier: Apache-2.0
//
// A redraw of the CG layer: a textured ball of 50 thousand triangles that fills 20 % of a 1024 x 768 picture,
// seen through a distorting lens; then the same scene at rest. Prints core-ms and the shares of visibility
// and shading.
#include <benchmark/benchmark.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "proto/base/check.h"
#include "server/render/cg_renderer.h"

namespace mixstage {
namespace {

PinholeCamera Camera() {
  PinholeCamera camera;
  camera.width = 1024, camera.height = 768;
  camera.fx = camera.fy = 1094, camera.cx = 521.5, camera.cy = 375.5;
  camera.k1 = -0.12, camera.k2 = 0.06;
  return camera;
}

// A ball of radius 1 about the origin, rows x 2 rows quads.
std::shared_ptr<const Mesh> Ball(int rows) {
  auto mesh = std::make_shared<Mesh>();
  const int columns = 2 * rows;
  for (int r = 0; r <= rows; ++r) {
    for (int c = 0; c <= columns; ++c) {
      const double theta = M_PI * r / rows;
      const double phi = 2 * M_PI * c / columns;
      const Eigen::Vector3d p(std::sin(theta) * std::cos(phi), -std::cos(theta),
                              std::sin(theta) * std::sin(phi));
      mesh->positions.push_back(p.cast<float>());
      mesh->normals.push_back(p.cast<float>());
      mesh->uvs.emplace_back(static_cast<float>(c) / static_cast<float>(columns),
                             static_cast<float>(r) / static_cast<float>(rows));
    }
  }
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const auto a = static_cast<std::uint32_t>(r * (columns + 1) + c);
      const auto b = a + static_cast<std::uint32_t>(columns) + 1;
      mesh->indices.insert(mesh->indices.end(), {a, a + 1, b, b, a + 1, b + 1});
    }
  }
  Texture texture;
  texture.rgba = cv::Mat4b(1024, 1024);
  cv::RNG rng(7);
  rng.fill(texture.rgba, cv::RNG::UNIFORM, 0, 256);
  for (cv::Vec4b& p : texture.rgba) p[3] = 255;
  mesh->textures.push_back(texture);
  Material material;
  material.texture = 0;
  material.double_sided = false;
  mesh->materials.push_back(material);
  mesh->parts.push_back({0, static_cast<std::uint32_t>(mesh->indices.size()), 0});
  return mesh;
}

Scene BallScene() {
  Scene scene;
  scene.frame = SceneFrame::kCamera;
  SceneObject ball;
  ball.name = "ball";
  ball.mesh = Ball(112);  // 50,176 triangles
  ball.T_scene_object.translate(Eigen::Vector3d(0, 0, 5));
  scene.objects.push_back(ball);
  return scene;
}

void RedrawBall(benchmark::State& state, RendererChoice choice) {
  Scene scene = BallScene();
  const auto device = ChooseBackend(choice);
  if (!device) return state.SkipWithError(device.error().message.c_str());
  auto renderer = CgRenderer::Create({}, Camera(), *device);
  MIX_CHECK(renderer.has_value());
  const Illumination light = IlluminationOf(scene, nullptr);
  double visibility_ms = 0;
  double shading_ms = 0;
  double covered = 0;
  for (auto unused : state) {
    ++scene.revision;
    const CgLayer& layer = renderer->Run(scene, RigidTransform::Identity(), light);
    visibility_ms += renderer->timing().visibility_ms;
    shading_ms += renderer->timing().shading_ms;
    covered = cv::countNonZero(layer.depth_m);
  }
  const auto n = static_cast<double>(state.iterations());
  state.counters["visibility_ms"] = visibility_ms / n;
  state.counters["shading_ms"] = shading_ms / n;
  state.counters["covered_%"] = 100.0 * covered / (1024 * 768);
  state.counters["triangles"] = static_cast<double>(scene.objects[0].mesh->triangle_count());
}
BENCHMARK_CAPTURE(RedrawBall, cpu, RendererChoice::kCpu)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(RedrawBall, egl, RendererChoice::kEgl)
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

void SceneAtRest(benchmark::State& state) {
  const Scene scene = BallScene();
  auto renderer = CgRenderer::Create({}, Camera());
  MIX_CHECK(renderer.has_value());
  const Illumination light = IlluminationOf(scene, nullptr);
  for (auto unused : state) {
    benchmark::DoNotOptimize(renderer->Run(scene, RigidTransform::Identity(), light).drawing);
  }
}
BENCHMARK(SceneAtRest)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage

BENCHMARK_MAIN();
