// SPDX-License-Identifier: Apache-2.0
//
// Meshes and scenes whose picture is known by heart.
#pragma once

#include <cmath>
#include <memory>
#include <vector>

#include "proto/geometry/camera_model.h"
#include "server/render/illumination.h"
#include "server/scene/scene.h"

namespace mixstage::test {

inline PinholeCamera StraightCamera() {
  PinholeCamera camera;
  camera.width = 320, camera.height = 240;
  camera.fx = camera.fy = 300, camera.cx = 159.5, camera.cy = 119.5;
  return camera;
}
inline PinholeCamera DistortedCamera() {
  PinholeCamera camera = StraightCamera();
  camera.k1 = -0.15, camera.k2 = 0.05, camera.p1 = 0.002, camera.p2 = -0.001;
  return camera;
}

// A rectangle in the xy plane about the origin, its front toward -z (to a camera that looks along z), u to
// the right (x), v down (y); steps x steps cells.
inline Mesh Rectangle(float width, float height, int steps = 1) {
  Mesh mesh;
  for (int j = 0; j <= steps; ++j) {
    for (int i = 0; i <= steps; ++i) {
      const float s = static_cast<float>(i) / static_cast<float>(steps);
      const float t = static_cast<float>(j) / static_cast<float>(steps);
      mesh.positions.emplace_back((s - 0.5f) * width, (t - 0.5f) * height, 0.0f);
      mesh.normals.emplace_back(0.0f, 0.0f, -1.0f);
      mesh.uvs.emplace_back(s, t);
    }
  }
  for (int j = 0; j < steps; ++j) {
    for (int i = 0; i < steps; ++i) {
      const auto a = static_cast<std::uint32_t>(j * (steps + 1) + i);
      const auto below = a + static_cast<std::uint32_t>(steps) + 1;
      mesh.indices.insert(mesh.indices.end(), {a, below, a + 1, a + 1, below, below + 1});
    }
  }
  mesh.materials.emplace_back();
  mesh.materials[0].double_sided = false;
  mesh.materials[0].roughness = 1.0f;
  mesh.parts.push_back({0, static_cast<std::uint32_t>(mesh.indices.size()), 0});
  return mesh;
}

inline SceneObject Placed(Mesh mesh, const Eigen::Affine3d& T_scene_object) {
  SceneObject object;
  object.name = "object";
  object.mesh = std::make_shared<const Mesh>(std::move(mesh));
  object.T_scene_object = T_scene_object;
  return object;
}
inline Eigen::Affine3d At(double x, double y, double z) {
  return Eigen::Affine3d(Eigen::Translation3d(x, y, z));
}

inline Scene CameraScene(std::vector<SceneObject> objects) {
  Scene scene;
  scene.frame = SceneFrame::kCamera;
  scene.objects = std::move(objects);
  return scene;
}

inline AmbientLight EvenAmbient(float level) {
  return AmbientLight::AboveBelow(Eigen::Vector3f::UnitZ(), Eigen::Vector3f::Constant(level),
                                  Eigen::Vector3f::Constant(level));
}
// Another light from every side, as a room's.
inline AmbientLight UnevenAmbient() {
  AmbientSum sum;
  sum.Add(-Eigen::Vector3f::UnitY(), 1.5f, {0.4f, 0.5f, 0.6f});
  sum.Add(Eigen::Vector3f(1, 2, -1).normalized(), 0.8f, {0.2f, 0.1f, 0.1f});
  sum.Add(Eigen::Vector3f(-2, 1, 0.5f).normalized(), 2.0f, {0.3f, 0.2f, 0.1f});
  return sum.Finish();
}

// Every surface shows its colour as it is: ambient 1 from everywhere.
inline Illumination EvenLight() {
  Illumination light;
  light.ambient = EvenAmbient(1.0f);
  return light;
}

}  // namespace mixstage::test
