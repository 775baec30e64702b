// SPDX-License-Identifier: Apache-2.0
#include "server/scene/placing.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mixstage {

Eigen::Affine3d TSceneObject(const Placing& placing, UpAxis usual_up) {
  constexpr double kRadPerDeg = std::numbers::pi / 180.0;
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.translate(Eigen::Vector3d(placing.position[0], placing.position[1], placing.position[2]));
  T.rotate(Eigen::AngleAxisd(placing.rotation_deg[2] * kRadPerDeg, Eigen::Vector3d::UnitZ()));
  T.rotate(Eigen::AngleAxisd(placing.rotation_deg[1] * kRadPerDeg, Eigen::Vector3d::UnitY()));
  T.rotate(Eigen::AngleAxisd(placing.rotation_deg[0] * kRadPerDeg, Eigen::Vector3d::UnitX()));
  T.scale(placing.scale);
  // y to z about x: (x, y, z) -> (x, -z, y).
  if (placing.up.value_or(usual_up) == UpAxis::kY) {
    T.rotate(Eigen::AngleAxisd(0.5 * std::numbers::pi, Eigen::Vector3d::UnitX()));
  }
  return T;
}

Placing PlacingOf(const Eigen::Affine3d& T_scene_object, const Placing& like, UpAxis usual_up) {
  Placing placing = like;
  const Eigen::Vector3d at = T_scene_object.translation();
  placing.position = {at.x(), at.y(), at.z()};
  Placing upright = like;
  upright.rotation_deg = {};
  const Eigen::Matrix3d R = T_scene_object.linear() * TSceneObject(upright, usual_up).linear().inverse();
  constexpr double kDegPerRad = 180.0 / std::numbers::pi;
  placing.rotation_deg = {kDegPerRad * std::atan2(R(2, 1), R(2, 2)),
                          kDegPerRad * std::asin(std::clamp(-R(2, 0), -1.0, 1.0)),
                          kDegPerRad * std::atan2(R(1, 0), R(0, 0))};
  return placing;
}

}  // namespace mixstage
