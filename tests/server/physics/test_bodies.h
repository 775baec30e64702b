// SPDX-License-Identifier: Apache-2.0
//
// Boxes, balls and rooms for tests of physics.
#pragma once

#include <cmath>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include "server/scene/scene.h"

namespace mixstage {

inline void AddQuad(std::vector<std::uint32_t>& indices, std::uint32_t a, std::uint32_t b, std::uint32_t c,
                    std::uint32_t d) {
  indices.insert(indices.end(), {a, b, c, a, c, d});
}

inline std::shared_ptr<Mesh> Finish(std::shared_ptr<Mesh> mesh) {
  mesh->normals.assign(mesh->positions.size(), Eigen::Vector3f::UnitZ());
  mesh->materials.emplace_back();
  mesh->parts.push_back({0, static_cast<std::uint32_t>(mesh->indices.size()), 0});
  return mesh;
}

inline void AddBox(Mesh& mesh, const Eigen::Vector3f& low, const Eigen::Vector3f& high) {
  const auto n = static_cast<std::uint32_t>(mesh.positions.size());
  for (int k = 0; k < 8; ++k) {
    mesh.positions.emplace_back((k & 1) != 0 ? high.x() : low.x(), (k & 2) != 0 ? high.y() : low.y(),
                                (k & 4) != 0 ? high.z() : low.z());
  }
  AddQuad(mesh.indices, n + 0, n + 2, n + 3, n + 1);
  AddQuad(mesh.indices, n + 4, n + 5, n + 7, n + 6);
  AddQuad(mesh.indices, n + 0, n + 1, n + 5, n + 4);
  AddQuad(mesh.indices, n + 2, n + 6, n + 7, n + 3);
  AddQuad(mesh.indices, n + 0, n + 4, n + 6, n + 2);
  AddQuad(mesh.indices, n + 1, n + 3, n + 7, n + 5);
}

// Sides in metres, the origin in the middle.
inline std::shared_ptr<const Mesh> BoxMesh(float x, float y, float z) {
  auto mesh = std::make_shared<Mesh>();
  AddBox(*mesh, Eigen::Vector3f(-x, -y, -z) / 2, Eigen::Vector3f(x, y, z) / 2);
  return Finish(mesh);
}

// A table-like thing of five boxes: a top and four legs, 0.4 m high, standing on its origin.
inline std::shared_ptr<const Mesh> StoolMesh() {
  auto mesh = std::make_shared<Mesh>();
  AddBox(*mesh, {-0.2f, -0.2f, 0.36f}, {0.2f, 0.2f, 0.4f});
  for (const float x : {-0.18f, 0.18f}) {
    for (const float y : {-0.18f, 0.18f})
      AddBox(*mesh, {x - 0.02f, y - 0.02f, 0.0f}, {x + 0.02f, y + 0.02f, 0.35f});
  }
  return Finish(mesh);
}

// A solid of revolution about z: (radius, z) from bottom to top.
inline std::shared_ptr<const Mesh> LatheMesh(const std::vector<std::pair<double, double>>& outline,
                                             int columns = 48) {
  auto mesh = std::make_shared<Mesh>();
  for (const auto& [r, z] : outline) {
    for (int c = 0; c < columns; ++c) {
      const double angle = 2 * std::numbers::pi * c / columns;
      mesh->positions.push_back(Eigen::Vector3d(r * std::cos(angle), r * std::sin(angle), z).cast<float>());
    }
  }
  for (std::size_t row = 0; row + 1 < outline.size(); ++row) {
    for (int c = 0; c < columns; ++c) {
      const auto at = [&](std::size_t r, int k) {
        return static_cast<std::uint32_t>(r * static_cast<std::size_t>(columns) +
                                          static_cast<std::size_t>(k % columns));
      };
      AddQuad(mesh->indices, at(row, c), at(row, c + 1), at(row + 1, c + 1), at(row + 1, c));
    }
  }
  return Finish(mesh);
}

inline std::shared_ptr<const Mesh> BallMesh(double radius) {
  std::vector<std::pair<double, double>> outline;
  for (int i = 0; i <= 24; ++i) {
    const double theta = std::numbers::pi * i / 24;
    outline.emplace_back(radius * std::sin(theta), -radius * std::cos(theta));
  }
  return LatheMesh(outline);
}

inline std::shared_ptr<const Mesh> VaseMesh() {
  return LatheMesh(
      {{0.0, 0.0}, {0.05, 0.0}, {0.1, 0.12}, {0.06, 0.22}, {0.04, 0.26}, {0.06, 0.3}, {0.0, 0.3}});
}

// A level grid of triangles of about cell_m at height z, rough_m up and down.
struct GridRoom {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::uint32_t> indices;
};
inline void AddGrid(GridRoom& room, double low_x, double high_x, double low_y, double high_y, double z,
                    int cells) {
  const auto n = static_cast<std::uint32_t>(room.positions.size());
  const auto row = static_cast<std::uint32_t>(cells + 1);
  for (int y = 0; y <= cells; ++y) {
    for (int x = 0; x <= cells; ++x) {
      room.positions.push_back(
          Eigen::Vector3d(low_x + (high_x - low_x) * x / cells, low_y + (high_y - low_y) * y / cells, z)
              .cast<float>());
    }
  }
  for (std::uint32_t y = 0; y + 1 < row; ++y) {
    for (std::uint32_t x = 0; x + 1 < row; ++x) {
      const std::uint32_t a = n + y * row + x;
      AddQuad(room.indices, a, a + 1, a + row + 1, a + row);
    }
  }
}

inline SceneObject Falling(std::shared_ptr<const Mesh> mesh, const Eigen::Vector3d& at) {
  SceneObject object;
  object.id = 1;
  object.name = "thing";
  object.mesh = std::move(mesh);
  object.T_scene_object.translate(at);
  object.drop = true;
  object.put = 1;
  object.body = Body::kActor;
  return object;
}

// Of the mesh as it stands: height of its lowest vertex.
inline double LowestOf(const SceneObject& object) {
  double lowest = 1e9;
  for (const Eigen::Vector3f& p : object.mesh->positions)
    lowest = std::min(lowest, (object.T_scene_object * p.cast<double>()).z());
  return lowest;
}

}  // namespace mixstage
