// SPDX-License-Identifier: Apache-2.0
//
// The actor in another space (piVE 5): where in a target he is put, and through which camera the target is
// seen. Both spaces are worlds of the same kind (metres, z up, floor at z = 0), so one rigid transform, which
// keeps what is upright upright, says where he is: his size, his perspective and what hides him follow from
// the target's camera. The paper's eq 9 is what is left of it without a turn.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <string>

#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"

namespace mixstage {

// A camera that nobody has: upright, its picture's centre on look_at.
struct AvatarCamera {
  Eigen::Vector3d position = Eigen::Vector3d::Zero(), look_at = Eigen::Vector3d::UnitX();  // target's world
  std::optional<double> view_deg;  // 5..120, across the picture; nothing = the show's own lens
  bool operator==(const AvatarCamera&) const = default;
};

struct Avatar {
  // At most one of them, relative to the scene's file; none: the show's own scanned room.
  std::string room;                                    // an environment folder
  std::string video;                                   // a capture folder with depth
  std::string poses;                                   // TUM lines of the video's T_world_color
  Eigen::Vector2d anchor = Eigen::Vector2d::Zero();    // a point of the floor that he walks on ...
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // ... and where in the target it comes to lie
  double turn_deg = 0;                                 // of his world about up through the anchor
  std::optional<AvatarCamera> camera;  // nothing = the show's own, where it stands in its own world

  [[nodiscard]] RigidTransform TTargetWorld() const;
  bool operator==(const Avatar&) const = default;
};

// Fails (kInvalidConfig) where it looks straight up or down, or nowhere.
[[nodiscard]] Result<RigidTransform> TTargetView(const AvatarCamera& camera);
// The lens of such a camera: own, or a pinhole without distortion of its size.
[[nodiscard]] PinholeCamera LensOf(const AvatarCamera& camera, const PinholeCamera& own);

}  // namespace mixstage
