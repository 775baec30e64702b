// SPDX-License-Identifier: Apache-2.0
//
// A model as something that can be touched (MixIn3D 3.1): what falls, rests and rolls is not the drawn
// triangles but a few convex parts, one for each piece of the model that hangs together: a ball, a box, or
// the hull of its vertices. Private to server/physics (Bullet's types).
#pragma once

#include <btBulletCollisionCommon.h>

#include <Eigen/Geometry>
#include <memory>
#include <vector>

#include "proto/base/result.h"
#include "server/scene/mesh.h"

namespace mixstage {

// Smaller things fall through what a camera can measure, larger ones are no objects on a stage.
inline constexpr double kLeastBodyM = 0.002, kLargestBodyM = 50;

struct BodyShape {
  // In the body's frame: metres, the origin in the centre of mass, axes as the object's after its stretch.
  // Surfaces are the model's to 0.1 mm for boxes and balls, and for hulls but at their rounded corners; the
  // margin lies inside.
  btCollisionShape* shape = nullptr;
  std::vector<std::unique_ptr<btCollisionShape>> owned;
  Eigen::Affine3d T_body_object = Eigen::Affine3d::Identity();  // file coordinates to the body's frame
  btVector3 inertia_per_kg{0, 0, 0};
  double inner_radius_m = 0;  // half the least extent
};

// A pose without its rotation and place: T_scene_object = T_scene_body * stretch about the file's origin,
// where T_scene_body turns and shifts and stretch is symmetric (it mirrors where the pose does).
struct SplitPose {
  Eigen::Isometry3d T_scene_stretched = Eigen::Isometry3d::Identity();
  Eigen::Matrix3d stretch = Eigen::Matrix3d::Identity();
};
[[nodiscard]] SplitPose Split(const Eigen::Affine3d& T_scene_object);

// Density is even over the convex parts. Fails (kBadInput) where the stretched model is smaller or larger
// than the limits above or not finite. Vertices no triangle uses do not count.
Result<BodyShape> MakeBodyShape(const Mesh& mesh, const Eigen::Matrix3d& stretch);

}  // namespace mixstage
