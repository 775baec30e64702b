// SPDX-License-Identifier: Apache-2.0
#include "server/scene/avatar.h"

#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr double kLeastLevel = 0.017;  // sine: within a degree of straight up or down there is no upright

}  // namespace

RigidTransform Avatar::TTargetWorld() const {
  RigidTransform T = RigidTransform::Identity();
  T.translate(position);
  T.rotate(Eigen::AngleAxisd(turn_deg * kRadPerDeg, Eigen::Vector3d::UnitZ()));
  T.translate(Eigen::Vector3d(-anchor.x(), -anchor.y(), 0));
  return T;
}

Result<RigidTransform> TTargetView(const AvatarCamera& camera) {
  const Eigen::Vector3d z = camera.look_at - camera.position;
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ());
  if (!(z.norm() > 1e-6) || !(x.norm() > kLeastLevel * z.norm())) {
    return Fail(ErrorCode::kInvalidConfig,
                "looks straight up or down: look_at must not lie above or below position");
  }
  RigidTransform T = RigidTransform::Identity();
  T.linear().col(0) = x.normalized();
  T.linear().col(2) = z.normalized();
  T.linear().col(1) = T.linear().col(2).cross(T.linear().col(0));
  T.translation() = camera.position;
  return T;
}

PinholeCamera LensOf(const AvatarCamera& camera, const PinholeCamera& own) {
  if (!camera.view_deg) return own;
  PinholeCamera lens;
  lens.width = own.width;
  lens.height = own.height;
  lens.fx = lens.fy = 0.5 * own.width / std::tan(0.5 * *camera.view_deg * kRadPerDeg);
  lens.cx = 0.5 * (own.width - 1);
  lens.cy = 0.5 * (own.height - 1);
  return lens;
}

}  // namespace mixstage
