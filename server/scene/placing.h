// SPDX-License-Identifier: Apache-2.0
//
// How a person places an object in scene.yaml when no pose is given.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <optional>

namespace mixstage {

enum class UpAxis {
  kY = 1,  // glTF, OBJ
  kZ,      // PLY
};

// The file's up axis is turned to z, then Rz Ry Rx, scale, shift.
struct Placing {
  std::array<double, 3> position{};      // m, scene frame
  std::array<double, 3> rotation_deg{};  // about x, y, z
  double scale = 1.0;                    // > 0
  std::optional<UpAxis> up;              // nothing: as usual for the kind of file
  bool operator==(const Placing&) const = default;
};
[[nodiscard]] Eigen::Affine3d TSceneObject(const Placing& placing, UpAxis usual_up);
// The placing of a pose that differs from TSceneObject(like) by place and rotation alone.
[[nodiscard]] Placing PlacingOf(const Eigen::Affine3d& T_scene_object, const Placing& like, UpAxis usual_up);

}  // namespace mixstage
