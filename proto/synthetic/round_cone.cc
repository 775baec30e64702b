// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/round_cone.h"

#include <algorithm>
#include <cmath>

namespace mixstage {

// With slope s and c^2 = 1 - s^2 the side is rho c + z s = radius_a, and the sphere that touches it at height
// z sits at k = (z - s radius_a) / c^2 with radius radius_a - s k; outside [0, length] an end sphere takes
// over.
double RoundCone::AxisOf(double local_z) const {
  const double s = Slope();
  return std::clamp((local_z - s * radius_a_m) / (1 - s * s), 0.0, length_m);
}

std::optional<double> RoundCone::Intersect(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                           double t_min) const {
  const Eigen::Vector3d o = to_local * (origin - a);
  const Eigen::Vector3d d = to_local * direction;
  const double s = Slope();
  const double cc = 1 - s * s;
  double best = INFINITY;
  auto offer = [&](double t) {
    if (t > t_min && t < best) best = t;
  };
  // The side; both roots, since a ray steeper than the cone enters through the second one.
  const double A = cc * (d.x() * d.x() + d.y() * d.y()) - s * s * d.z() * d.z();
  const double rim = radius_a_m - s * o.z();
  const double B = cc * (o.x() * d.x() + o.y() * d.y()) + rim * s * d.z();
  const double C = cc * (o.x() * o.x() + o.y() * o.y()) - rim * rim;
  const double h = B * B - A * C;
  if (h >= 0 && A != 0) {
    for (const double root : {-std::sqrt(h), std::sqrt(h)}) {
      const double t = (-B + root) / A;
      const double z = o.z() + t * d.z();
      if (z >= s * radius_a_m && z <= length_m + s * radius_b_m) offer(t);
    }
  }
  // The ends: a near root inside the hull is never the first one, so no more needs checking.
  const double q = d.squaredNorm();
  for (const auto& [center_z, radius] : {std::pair(0.0, radius_a_m), std::pair(length_m, radius_b_m)}) {
    const Eigen::Vector3d oc = o - Eigen::Vector3d(0, 0, center_z);
    const double b = oc.dot(d);
    const double hs = b * b - q * (oc.squaredNorm() - radius * radius);
    if (hs >= 0) offer((-b - std::sqrt(hs)) / q);
  }
  // From outside: a side root that is an exit cannot come first unless the ray starts inside.
  if (!std::isfinite(best)) return std::nullopt;
  return best;
}

Eigen::Vector3d RoundCone::Normal(const Eigen::Vector3d& p) const {
  Eigen::Vector3d n = to_local * (p - a);
  n.z() -= AxisOf(n.z());
  return (to_local.transpose() * n).normalized();
}

Eigen::AlignedBox3d RoundCone::Bounds() const {
  const Eigen::Matrix3d from_local = to_local.inverse();
  const Eigen::Vector3d reach = from_local.rowwise().norm();  // half extents of a unit sphere
  const Eigen::Vector3d b = a + from_local * Eigen::Vector3d(0, 0, length_m);
  Eigen::AlignedBox3d box(a - radius_a_m * reach, a + radius_a_m * reach);
  box.extend(Eigen::AlignedBox3d(b - radius_b_m * reach, b + radius_b_m * reach));
  return box;
}

RoundCone MakeRoundCone(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius_a_m,
                        double radius_b_m, const Eigen::Vector3d& side, double stretch_side,
                        double stretch_front) {
  const Eigen::Vector3d along = b - a;
  RoundCone cone;
  cone.a = a;
  cone.length_m = along.norm();
  cone.radius_a_m = radius_a_m;
  // A sphere that holds the other one is the hull; keep the slope below 1.
  cone.radius_b_m =
      std::clamp(radius_b_m, radius_a_m - 0.95 * cone.length_m, radius_a_m + 0.95 * cone.length_m);
  const Eigen::Vector3d axis =
      cone.length_m > 1e-9 ? Eigen::Vector3d(along / cone.length_m) : Eigen::Vector3d::UnitZ();
  Eigen::Vector3d x = side - side.dot(axis) * axis;
  if (x.squaredNorm() < 1e-8) x = axis.unitOrthogonal();
  x.normalize();
  cone.to_local.row(0) = x / stretch_side;
  cone.to_local.row(1) = axis.cross(x) / stretch_front;
  cone.to_local.row(2) = axis;
  return cone;
}

RoundCone MakeEllipsoid(const Eigen::Vector3d& center, const Eigen::Matrix3d& axes,
                        const Eigen::Vector3d& half_axes_m) {
  RoundCone cone;
  cone.a = center;
  cone.radius_a_m = cone.radius_b_m = 1;
  cone.to_local = half_axes_m.cwiseInverse().asDiagonal() * axes.transpose();
  return cone;
}

}  // namespace mixstage
