// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/head_base.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;

RigidTransform Turn(const Eigen::Vector3d& axis, double angle_rad) {
  return RigidTransform(Eigen::AngleAxisd(angle_rad, axis));
}

}  // namespace

RigidTransform BaseOfNominal(const PanTilt& nominal) {
  const auto sign = [](double scale) { return scale < 0 ? -1.0 : 1.0; };
  const RigidTransform pan_zero =
      Turn(nominal.pan_axis.direction.normalized(), nominal.pan_offset_deg * kRadPerDeg);
  const Eigen::Vector3d point = nominal.pan_axis.point,
                        n = sign(nominal.pan_scale) * nominal.pan_axis.direction.normalized();
  const Eigen::Vector3d tilt =
      sign(nominal.tilt_scale) * (pan_zero.linear() * nominal.tilt_axis.direction.normalized());
  const Eigen::Vector3d tilt_point = point + pan_zero.linear() * (nominal.tilt_axis.point - point);
  Eigen::Vector3d heading = tilt - n * n.dot(tilt);
  // Where the tilt axis passes the pan axis: nearest points of two lines.
  double along = n.dot(tilt_point - point);
  if (const double s = heading.squaredNorm(); s > 1e-6)
    along -= heading.dot(tilt_point - point) / s * n.dot(tilt);
  if (heading.norm() < 1e-3) heading = n.unitOrthogonal();
  heading.normalize();
  RigidTransform T = RigidTransform::Identity();
  T.linear().col(1) = -heading;
  T.linear().col(2) = n;
  T.linear().col(0) = T.linear().col(1).cross(n);
  T.translation() = point + along * n;
  return T;
}

RigidTransform BaseByConvention(const RigidTransform& T_hand_color) {
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ() * (T_hand_color.linear()(2, 1) > 0 ? -1.0 : 1.0);
  Eigen::Vector3d forward = T_hand_color.linear().col(2);
  forward -= up * up.dot(forward);
  if (forward.norm() < 1e-3) forward = Eigen::Vector3d::UnitX();
  forward.normalize();
  RigidTransform T = RigidTransform::Identity();
  T.linear().row(0) = forward.transpose();
  T.linear().row(1) = up.cross(forward).transpose();
  T.linear().row(2) = up.transpose();
  return T;
}

PanTilt InBase(const HandEyeAdjustment& problem, const std::optional<PanTilt>& nominal,
               const RigidTransform& T_base_own) {
  PanTilt ptu = nominal.value_or(PanTilt{});
  const Eigen::Vector4d& m = problem.mechanism;
  if (!nominal) ptu.pan_axis = {T_base_own.linear().col(2), T_base_own.translation()};
  const auto about = [](const PanTilt::Axis& axis, double angle_rad) {
    RigidTransform T = Turn(axis.direction.normalized(), angle_rad);
    T.translation() = axis.point - T.linear() * axis.point;
    return T;
  };
  const RigidTransform at_zero = about(ptu.pan_axis, -ptu.pan_offset_deg * kRadPerDeg) * T_base_own;
  const double pan_sign = ptu.pan_scale < 0 ? -1 : 1, tilt_sign = ptu.tilt_scale < 0 ? -1 : 1;
  ptu.pan_scale = pan_sign * m[2];
  ptu.tilt_scale = tilt_sign * m[3];
  ptu.tilt_axis.direction =
      tilt_sign * (at_zero.linear() * Eigen::Vector3d(0, -std::cos(m[1]), std::sin(m[1])));
  ptu.tilt_axis.point = at_zero * Eigen::Vector3d(m[0], 0, 0);
  ptu.T_tilt_color = about(ptu.tilt_axis, -ptu.tilt_offset_deg * kRadPerDeg) * at_zero * problem.T_hand_color;
  return ptu;
}

}  // namespace mixstage
