// SPDX-License-Identifier: Apache-2.0
//
// Shapes that cast shadows: models reduced to what a shadow shows, and the actor's depth surface with a back.
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/geometry/frames.h"
#include "server/render/shadow_map.h"
#include "server/scene/mesh.h"
#include "server/scene/mesh_motion.h"

namespace mixstage {

// A part of a surface, as it hides what is behind it from the ambient light.
struct Surfel {
  Eigen::Vector3f center = Eigen::Vector3f::Zero();
  Eigen::Vector3f facing = Eigen::Vector3f::Zero();  // outward normal times area
};

struct ShadowShape {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::uint32_t> indices;
  std::vector<std::uint32_t> sources;  // of a model: the vertex that each position is
  std::vector<Surfel> surfels;
  std::vector<std::uint32_t> surfel_of;              // each triangle, where there are surfels
  Eigen::Vector3f center = Eigen::Vector3f::Zero();  // of a sphere around it
  float radius_m = 0;

  void FindSphere();
};

// About as many triangles at most; masked materials (leaves) count as if they were whole. bones: of every
// position where they move, so that corners stay apart that may part; else empty.
[[nodiscard]] ShadowShape Reduced(std::span<const Eigen::Vector3f> positions,
                                  std::span<const std::uint32_t> indices, std::size_t most_triangles,
                                  std::span<const VertexBones> bones = {});
// With surfels.
[[nodiscard]] ShadowShape ShadowShapeOf(const Mesh& mesh);
// The same mesh's shape with its vertices there.
[[nodiscard]] ShadowShape Posed(const ShadowShape& shape, std::span<const Eigen::Vector3f> vertices);

// The actor in the scene: his depth surface and, as no camera sees it, a back behind it, so far behind as the
// middle of his limbs is from their outline, kActorThickness_m at the most (algorithms 9).
class ActorShape {
 public:
  static constexpr float kActorThickness_m = 0.25f;
  // step_px: of depth_m's pixels, from a corner to the next.
  explicit ActorShape(int step_px = 6) : step_px_(step_px) {}
  // half_rays [Half(h) x Half(w)] (x/z, y/z) of depth_m's pixels; depth_m [same] z, 0 = not he.
  const ShadowShape& Run(const cv::Mat2f& half_rays, const cv::Mat1f& depth_m,
                         const RigidTransform& T_scene_color);

 private:
  int step_px_ = 0;
  cv::Mat1b inside_;
  cv::Mat1f depth_m_, from_edge_px_;
  cv::Mat1i number_;
  ShadowShape shape_;
};

}  // namespace mixstage
