// SPDX-License-Identifier: Apache-2.0
//
// Physics for a frame of a show: 200 bodies (boxes, balls, vases) on floor and tables of a room of 100
// thousand triangles, and an actor at 2.5 m who wades through them. Prints core-ms a frame, mean and worst,
// while they fall and when they lie around him.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>

#include "proto/base/clock.h"
#include "proto/base/image_view.h"
#include "server/physics/actor_collider.h"
#include "server/physics/physics.h"
#include "tests/server/physics/test_bodies.h"

namespace mixstage {
namespace {

PinholeCamera Camera() {
  PinholeCamera camera;
  camera.width = 1024, camera.height = 768;
  camera.fx = camera.fy = 1094, camera.cx = 521.5, camera.cy = 375.5;
  return camera;
}

// At 1.4 m above the floor, looking along x.
RigidTransform TSceneColor() {
  RigidTransform T = RigidTransform::Identity();
  T.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  T.translation() = Eigen::Vector3d(-2.5, 0, 1.4);
  return T;
}

// A body of 0.5 x 1.7 m that sways.
cv::Mat1f ActorDepth(int frame) {
  cv::Mat1f depth_m(384, 512, 0.0f);
  const double y = 0.6 * std::sin(frame / 20.0);
  const int left = static_cast<int>(260 - 547 * (y + 0.25) / 2.5);
  const cv::Rect body = cv::Rect(left, 130, 109, 254) & cv::Rect({}, depth_m.size());
  for (int v = body.y; v < body.br().y; ++v) {
    for (int u = body.x; u < body.br().x; ++u)
      depth_m(v, u) = 2.5f + 0.003f * static_cast<float>((u * 7 + v * 13 + frame * 5) % 5);
  }
  return depth_m;
}

void TwoHundredBodies(benchmark::State& state) {
  GridRoom room;
  AddGrid(room, -4, 4, -4, 4, 0, 200);
  AddGrid(room, 0.5, 1.7, -1.5, -0.7, 0.75, 80);
  const std::shared_ptr<const Mesh> meshes[] = {BoxMesh(0.12f, 0.2f, 0.1f), BallMesh(0.08), VaseMesh(),
                                                BoxMesh(0.15f, 0.15f, 0.15f)};
  Scene scene;
  for (int i = 0; i < 200; ++i) {
    SceneObject object = Falling(meshes[i % 4], {-1.0 + 0.3 * (i % 14), -2.0 + 0.28 * (i / 14), 0.3});
    object.id = static_cast<std::uint32_t>(i + 1);
    scene.objects.push_back(std::move(object));
  }
  Physics physics(SceneFrame::kWorld);
  physics.SetRoom(room.positions, room.indices);
  physics.SetScene(scene);
  ActorCollider collider(Camera());
  std::int64_t t_us = 0;
  int frame = 0;
  const int skip = static_cast<int>(state.range(0));
  double worst_ms = 0;
  std::size_t balls = 0;
  const auto step = [&](const cv::Mat1f& depth_m) {
    t_us += 33'333;
    const auto reach = physics.ActorReach();
    const auto actor = collider.Run(View(depth_m), TSceneColor(), reach, t_us);
    balls = actor.size();
    physics.StepTo(t_us, actor);
    benchmark::DoNotOptimize(physics.WritePoses(scene));
    benchmark::DoNotOptimize(physics.TakeEvents());
  };
  for (; frame < skip; ++frame) step(ActorDepth(frame));
  for (auto _ : state) {
    state.PauseTiming();
    const cv::Mat1f depth_m = ActorDepth(frame++);
    state.ResumeTiming();
    const std::int64_t before_us = ProcessCpuMicros();
    step(depth_m);
    worst_ms = std::max(worst_ms, static_cast<double>(ProcessCpuMicros() - before_us) * 1e-3);
  }
  state.counters["worst_ms"] = worst_ms;
  state.counters["actor_balls"] = static_cast<double>(balls);
}
BENCHMARK(TwoHundredBodies)->Arg(0)->Arg(150)->Iterations(150)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage

BENCHMARK_MAIN();
