// SPDX-License-Identifier: Apache-2.0
#include "server/scene/mesh.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// Of a degenerate triangle or a normal that cancelled out: any direction is as good, up is never surprising.
Eigen::Vector3f NormalOr(const Eigen::Vector3f& n, const Eigen::Vector3f& otherwise) {
  const float length = n.norm();
  return std::isfinite(length) && length > 1e-20f ? Eigen::Vector3f(n / length) : otherwise;
}

Eigen::Vector3f FaceNormal(const Mesh& mesh, std::size_t first) {
  const Eigen::Vector3d a = mesh.positions[mesh.indices[first]].cast<double>();
  const Eigen::Vector3d b = mesh.positions[mesh.indices[first + 1]].cast<double>();
  const Eigen::Vector3d c = mesh.positions[mesh.indices[first + 2]].cast<double>();
  const Eigen::Vector3d n = (b - a).cross(c - a);
  const double length = n.norm();
  return length > 0 ? Eigen::Vector3f((n / length).cast<float>()) : Eigen::Vector3f::Zero();
}

template <typename T>
void Gather(std::vector<T>& values, const std::vector<std::uint32_t>& indices) {
  if (values.empty()) return;
  std::vector<T> gathered(indices.size());
  std::transform(indices.begin(), indices.end(), gathered.begin(),
                 [&](std::uint32_t i) { return values[i]; });
  values = std::move(gathered);
}

template <typename T>
void AppendAttribute(std::vector<T>& a, std::size_t a_vertices, std::vector<T>& b, std::size_t b_vertices,
                     const T& fill) {
  if (a.empty() && b.empty()) return;
  a.resize(a_vertices, fill);
  b.resize(b_vertices, fill);
  a.insert(a.end(), b.begin(), b.end());
}

}  // namespace

Eigen::AlignedBox3f Mesh::Bounds() const {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& p : positions) box.extend(p);
  return box;
}

void AppendTriangles(Mesh& a, Mesh&& b) {
  const auto vertices = static_cast<std::uint32_t>(a.positions.size());
  const auto indices = static_cast<std::uint32_t>(a.indices.size());
  AppendAttribute<Eigen::Vector2f>(a.uvs, a.positions.size(), b.uvs, b.positions.size(),
                                   Eigen::Vector2f::Zero());
  AppendAttribute<Eigen::Vector3f>(a.colors, a.positions.size(), b.colors, b.positions.size(),
                                   Eigen::Vector3f::Ones());
  AppendAttribute<Eigen::Vector3f>(a.normals, a.positions.size(), b.normals, b.positions.size(),
                                   Eigen::Vector3f::UnitZ());
  a.positions.insert(a.positions.end(), b.positions.begin(), b.positions.end());
  for (const std::uint32_t i : b.indices) a.indices.push_back(i + vertices);
  for (MeshPart part : b.parts) {
    part.first_index += indices;
    a.parts.push_back(part);
  }
}

void SmoothNormals(Mesh& mesh, const std::vector<std::uint32_t>& position_of_vertex) {
  MIX_CHECK(position_of_vertex.empty() || position_of_vertex.size() == mesh.positions.size());
  std::vector<std::uint32_t> identity;
  if (position_of_vertex.empty()) {
    identity.resize(mesh.positions.size());
    std::iota(identity.begin(), identity.end(), 0u);
  }
  const std::vector<std::uint32_t>& group = position_of_vertex.empty() ? identity : position_of_vertex;
  const std::uint32_t groups = group.empty() ? 0 : *std::max_element(group.begin(), group.end()) + 1;
  std::vector<Eigen::Vector3f> sums(groups, Eigen::Vector3f::Zero());
  for (std::size_t t = 0; t + 2 < mesh.indices.size(); t += 3) {
    const Eigen::Vector3f normal = FaceNormal(mesh, t);
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const std::uint32_t i = mesh.indices[t + corner];
      const Eigen::Vector3f to_next = mesh.positions[mesh.indices[t + (corner + 1) % 3]] - mesh.positions[i];
      const Eigen::Vector3f to_last = mesh.positions[mesh.indices[t + (corner + 2) % 3]] - mesh.positions[i];
      const float scale = to_next.norm() * to_last.norm();
      if (!(scale > 0)) continue;
      sums[group[i]] += std::acos(std::clamp(to_next.dot(to_last) / scale, -1.0f, 1.0f)) * normal;
    }
  }
  mesh.normals.resize(mesh.positions.size());
  for (std::size_t i = 0; i < mesh.normals.size(); ++i) {
    mesh.normals[i] = NormalOr(sums[group[i]], Eigen::Vector3f::UnitZ());
  }
}

void FlatNormals(Mesh& mesh) {
  std::vector<Eigen::Vector3f> normals(mesh.indices.size());
  for (std::size_t t = 0; t + 2 < mesh.indices.size(); t += 3) {
    const Eigen::Vector3f normal = NormalOr(FaceNormal(mesh, t), Eigen::Vector3f::UnitZ());
    normals[t] = normals[t + 1] = normals[t + 2] = normal;
  }
  Gather(mesh.positions, mesh.indices);
  Gather(mesh.uvs, mesh.indices);
  Gather(mesh.colors, mesh.indices);
  mesh.normals = std::move(normals);
  std::iota(mesh.indices.begin(), mesh.indices.end(), 0u);
}

}  // namespace mixstage
