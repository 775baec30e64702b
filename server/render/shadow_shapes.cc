// SPDX-License-Identifier: Apache-2.0
#include "server/render/shadow_shapes.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

namespace mixstage {
namespace {

constexpr std::size_t kMostTriangles = 2000;
constexpr float kReducedError = 0.02f;  // of the model's size
constexpr int kSurfelCells = 4;         // along the longest side
constexpr float kActorStep_m = 0.25f;   // of two neighbours so far apart in depth one hides the other

std::array<Eigen::Vector3f, 3> Corners(const ShadowShape& shape, std::size_t first) {
  return {shape.positions[shape.indices[first]], shape.positions[shape.indices[first + 1]],
          shape.positions[shape.indices[first + 2]]};
}

// Triangles of one cell that face about the same way are one.
void GroupSurfels(ShadowShape& shape) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& p : shape.positions) box.extend(p);
  const float cell = std::max(1e-6f, box.sizes().maxCoeff() / kSurfelCells);
  std::map<std::array<int, 4>, std::uint32_t> numbers;
  for (std::size_t i = 0; i < shape.indices.size(); i += 3) {
    const auto [a, b, c] = Corners(shape, i);
    const Eigen::Vector3f facing = (b - a).cross(c - a);
    Eigen::Index axis = 0;
    facing.cwiseAbs().maxCoeff(&axis);
    const Eigen::Vector3f at = ((a + b + c) / 3 - box.min()) / cell;
    const std::array<int, 4> place = {static_cast<int>(at.x()), static_cast<int>(at.y()),
                                      static_cast<int>(at.z()),
                                      2 * static_cast<int>(axis) + (facing[axis] < 0 ? 1 : 0)};
    const auto next = static_cast<std::uint32_t>(numbers.size());
    shape.surfel_of.push_back(numbers.try_emplace(place, next).first->second);
  }
  shape.surfels.resize(numbers.size());
}

void MeasureSurfels(ShadowShape& shape) {
  std::ranges::fill(shape.surfels, Surfel{});
  std::vector<float> areas(shape.surfels.size());
  for (std::size_t i = 0; i < shape.indices.size(); i += 3) {
    const auto [a, b, c] = Corners(shape, i);
    const Eigen::Vector3f facing = 0.5f * (b - a).cross(c - a);
    const float area = facing.norm();
    const std::uint32_t number = shape.surfel_of[i / 3];
    shape.surfels[number].center += area * (a + b + c) / 3;
    shape.surfels[number].facing += facing;
    areas[number] += area;
  }
  for (std::size_t k = 0; k < areas.size(); ++k) {
    if (areas[k] > 0) shape.surfels[k].center /= areas[k];
  }
}

}  // namespace

void ShadowShape::FindSphere() {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& p : positions) box.extend(p);
  center = box.isEmpty() ? Eigen::Vector3f(Eigen::Vector3f::Zero()) : box.center();
  float squared = 0;
  for (const Eigen::Vector3f& p : positions) squared = std::max(squared, (p - center).squaredNorm());
  radius_m = std::sqrt(squared);
}

ShadowShape Reduced(std::span<const Eigen::Vector3f> positions, std::span<const std::uint32_t> indices,
                    std::size_t most_triangles, std::span<const VertexBones> bones) {
  ShadowShape shape;
  if (positions.empty() || indices.empty()) return shape;
  // Corners in one place are one: seams of texture and normals would tear.
  const std::array<meshopt_Stream, 2> streams = {
      meshopt_Stream{positions.data(), sizeof(Eigen::Vector3f), sizeof(Eigen::Vector3f)},
      {bones.data(), sizeof(VertexBones), sizeof(VertexBones)}};
  std::vector<std::uint32_t> same(positions.size());
  const std::size_t unique = meshopt_generateVertexRemapMulti(
      same.data(), indices.data(), indices.size(), positions.size(), streams.data(), bones.empty() ? 1 : 2);
  std::vector<Eigen::Vector3f> corners(unique);
  meshopt_remapVertexBuffer(corners.data(), positions.data(), positions.size(), sizeof(Eigen::Vector3f),
                            same.data());
  std::vector<std::uint32_t> all(indices.size());
  for (std::size_t i = 0; i < indices.size(); ++i) all[i] = same[indices[i]];
  shape.indices = all;
  const float* first = corners[0].data();
  if (all.size() > 3 * most_triangles) {
    shape.indices.resize(meshopt_simplify(shape.indices.data(), all.data(), all.size(), first, unique,
                                          sizeof(Eigen::Vector3f), 3 * most_triangles, kReducedError));
    if (shape.indices.size() > 6 * most_triangles) {
      const std::vector<std::uint32_t> from = shape.indices;
      shape.indices.resize(meshopt_simplifySloppy(shape.indices.data(), from.data(), from.size(), first,
                                                  unique, sizeof(Eigen::Vector3f), 3 * most_triangles,
                                                  1e-1f));
    }
  }
  std::vector<std::uint32_t> kept(unique);
  shape.sources.resize(
      meshopt_optimizeVertexFetchRemap(kept.data(), shape.indices.data(), shape.indices.size(), unique));
  for (std::uint32_t& index : shape.indices) index = kept[index];
  for (std::uint32_t i = 0; i < same.size(); ++i) {
    if (same[i] != ~0u && kept[same[i]] != ~0u) shape.sources[kept[same[i]]] = i;
  }
  for (const std::uint32_t source : shape.sources) shape.positions.push_back(positions[source]);
  shape.FindSphere();
  return shape;
}

ShadowShape ShadowShapeOf(const Mesh& mesh) {
  std::span<const VertexBones> bones;
  if (mesh.motion != nullptr) bones = mesh.motion->vertices;
  ShadowShape shape = Reduced(mesh.positions, mesh.indices, kMostTriangles, bones);
  GroupSurfels(shape);
  MeasureSurfels(shape);
  return shape;
}

ShadowShape Posed(const ShadowShape& shape, std::span<const Eigen::Vector3f> vertices) {
  ShadowShape posed = shape;
  for (std::size_t k = 0; k < posed.sources.size(); ++k) posed.positions[k] = vertices[posed.sources[k]];
  posed.FindSphere();
  MeasureSurfels(posed);
  return posed;
}

const ShadowShape& ActorShape::Run(const cv::Mat2f& half_rays, const cv::Mat1f& depth_m,
                                   const RigidTransform& T_scene_color) {
  shape_.positions.clear();
  shape_.indices.clear();
  const int w = depth_m.cols / step_px_, h = depth_m.rows / step_px_;
  depth_m_.create(h, w);
  inside_.create(h, w);
  for (int y = 0; y < h; ++y) {
    const float* row = depth_m[step_px_ * y + step_px_ / 2];
    for (int x = 0; x < w; ++x) {
      depth_m_(y, x) = row[step_px_ * x + step_px_ / 2];
      inside_(y, x) = depth_m_(y, x) > 0 ? 255 : 0;
    }
  }
  if (cv::countNonZero(inside_) == 0) {
    shape_.FindSphere();
    return shape_;
  }
  cv::distanceTransform(inside_, from_edge_px_, cv::DIST_L2, 3);
  number_.create(h, w);
  const Eigen::Matrix3f R = T_scene_color.linear().cast<float>();
  const Eigen::Vector3f t = T_scene_color.translation().cast<float>();
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      number_(y, x) = -1;
      const float z = depth_m_(y, x);
      const cv::Vec2f& ray = half_rays(step_px_ * y + step_px_ / 2, step_px_ * x + step_px_ / 2);
      if (!(z > 0) || ray[0] != ray[0]) continue;
      number_(y, x) = static_cast<int>(shape_.positions.size());
      const float cell = half_rays(0, 1)[0] - half_rays(0, 0)[0];
      const float thick =
          std::min(kActorThickness_m, 2 * from_edge_px_(y, x) * static_cast<float>(step_px_) * cell * z);
      const Eigen::Vector3f along(ray[0], ray[1], 1);
      shape_.positions.push_back(R * (z * along) + t);
      shape_.positions.push_back(R * (z * along + thick * along.normalized()) + t);
    }
  }
  const auto add = [&](int a, int b, int c) {
    for (const int side : {0, 1}) {
      for (const int k : {a, b, c}) shape_.indices.push_back(static_cast<std::uint32_t>(k + side));
    }
  };
  for (int y = 0; y + 1 < h; ++y) {
    for (int x = 0; x + 1 < w; ++x) {
      const std::array<cv::Point, 4> at = {cv::Point(x, y), {x + 1, y}, {x, y + 1}, {x + 1, y + 1}};
      const auto joined = [&](std::size_t i, std::size_t j, std::size_t k) {
        if (number_(at[i]) < 0 || number_(at[j]) < 0 || number_(at[k]) < 0) return;
        const auto [low, high] = std::minmax({depth_m_(at[i]), depth_m_(at[j]), depth_m_(at[k])});
        if (high - low < kActorStep_m) add(number_(at[i]), number_(at[j]), number_(at[k]));
      };
      if (number_(at[0]) >= 0 && number_(at[3]) >= 0) {
        joined(0, 1, 3);
        joined(0, 3, 2);
      } else {
        joined(0, 1, 2);
        joined(1, 3, 2);
      }
    }
  }
  shape_.FindSphere();
  return shape_;
}

}  // namespace mixstage
