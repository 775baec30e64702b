// SPDX-License-Identifier: Apache-2.0
#include "proto/base/check.h"
#include "server/scene/scene.h"

namespace mixstage {
namespace {

Mesh PatchMesh(const Reflector& reflector) {
  MIX_CHECK(reflector.color && reflector.polygon.size() >= 3);
  const Eigen::Vector3d normal = reflector.plane.head<3>();
  Mesh mesh;
  for (const Eigen::Vector3d& corner : reflector.polygon) {
    const double off = normal.dot(corner) + reflector.plane.w();
    mesh.positions.push_back((corner - off * normal).cast<float>());
    mesh.normals.push_back(normal.cast<float>());
  }
  for (std::uint32_t i = 2; i < mesh.positions.size(); ++i)
    mesh.indices.insert(mesh.indices.end(), {0, i - 1, i});
  Material material;
  material.name = reflector.name;
  material.base_color = *reflector.color;
  material.head_on = 0;  // what it mirrors is drawn as a reflection
  mesh.materials.push_back(std::move(material));
  mesh.parts.push_back({0, static_cast<std::uint32_t>(mesh.indices.size()), 0});
  return mesh;
}

}  // namespace

std::vector<SceneObject> PatchObjects(const Scene& scene) {
  std::vector<SceneObject> patches;
  for (const Reflector& reflector : scene.reflectors) {
    if (!reflector.color) continue;
    SceneObject object;
    object.name = reflector.name;
    object.mesh = std::make_shared<const Mesh>(PatchMesh(reflector));
    object.body = Body::kIsolated;
    patches.push_back(std::move(object));
  }
  return patches;
}

}  // namespace mixstage
