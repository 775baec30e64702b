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

void AddSurfels(ShadowShape& shape) {
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& p : shape.positions) box.extend(p);
  const float cell = std::max(1e-6f, box.sizes().maxCoeff() / kSurfelCells);
  struct Sum {
    Eigen::Vector3f center = Eigen::Vector3f::Zero(), facing = Eigen::Vector3f::Zero();
    float area = 0;
  };
  std::map<std::array<int, 4>, Sum> sums;
  for (std::size_t i = 0; i < shape.indices.size(); i += 3) {
    const Eigen::Vector3f& a = shape.positions[shape.indices[i]];
    const Eigen::Vector3f& b = shape.positions[shape.indices[i + 1]];
    const Eigen::Vector3f& c = shape.positions[shape.indices[i + 2]];
    const Eigen::Vector3f facing = 0.5f * (b - a).cross(c - a);
    const float area = facing.norm();
    if (!(area > 0)) continue;
    Eigen::Index axis = 0;
    facing.cwiseAbs().maxCoeff(&axis);
    const Eigen::Vector3f at = ((a + b + c) / 3 - box.min()) / cell;
    Sum& sum = sums[{static_cast<int>(at.x()), static_cast<int>(at.y()), static_cast<int>(at.z()),
                     2 * static_cast<int>(axis) + (facing[axis] < 0 ? 1 : 0)}];
    sum.center += area * (a + b + c) / 3;
    sum.facing += facing;
    sum.area += area;
  }
  for (const auto& [cell_of, sum] : sums) shape.surfels.push_back({sum.center / sum.area, sum.facing});
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
                    std::size_t most_triangles) {
  ShadowShape shape;
  if (positions.empty() || indices.empty()) return shape;
  // Corners in one place are one: seams of texture and normals would tear.
  std::vector<std::uint32_t> same(positions.size());
  const std::size_t unique = meshopt_generateVertexRemap(
      same.data(), nullptr, positions.size(), positions.data(), positions.size(), sizeof(Eigen::Vector3f));
  shape.positions.resize(unique);
  meshopt_remapVertexBuffer(shape.positions.data(), positions.data(), positions.size(),
                            sizeof(Eigen::Vector3f), same.data());
  std::vector<std::uint32_t> all(indices.size());
  for (std::size_t i = 0; i < indices.size(); ++i) all[i] = same[indices[i]];
  shape.indices = all;
  const float* first = shape.positions[0].data();
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
  const std::size_t left =
      meshopt_optimizeVertexFetch(shape.positions.data(), shape.indices.data(), shape.indices.size(),
                                  shape.positions.data(), unique, sizeof(Eigen::Vector3f));
  shape.positions.resize(left);
  shape.FindSphere();
  return shape;
}

ShadowShape ShadowShapeOf(const Mesh& mesh) {
  ShadowShape shape = Reduced(mesh.positions, mesh.indices, kMostTriangles);
  AddSurfels(shape);
  return shape;
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
