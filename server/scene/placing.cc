// SPDX-License-Identifier: Apache-2.0
#include "server/scene/placing.h"

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

}  // namespace mixstage
