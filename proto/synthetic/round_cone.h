// SPDX-License-Identifier: Apache-2.0
//
// The one shape of bodies, leaves and lamps: the hull of two spheres, stretched along three axes of its own.
// Spheres, ellipsoids, capsules and tapered limbs are all of it.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

namespace mixstage {

// Local frame: sphere `radius_a_m` at 0, sphere `radius_b_m` at (0, 0, length_m); local = to_local * (p - a).
struct RoundCone {
  Eigen::Vector3d a = Eigen::Vector3d::Zero();  // m, in the frame the cone lives in
  Eigen::Matrix3d to_local = Eigen::Matrix3d::Identity();
  double length_m = 0;
  double radius_a_m = 0.1, radius_b_m = 0.1;

  // sin of the side's slope; |radius_a - radius_b| < length is required where length > 0.
  [[nodiscard]] double Slope() const { return length_m > 0 ? (radius_a_m - radius_b_m) / length_m : 0.0; }
  // The point on the cone's axis (local z in [0, length]) whose sphere touches the surface at height
  // `local_z`.
  [[nodiscard]] double AxisOf(double local_z) const;

  // First t > t_min of origin + t * direction from outside; direction of any length. Nothing where it misses.
  [[nodiscard]] std::optional<double> Intersect(const Eigen::Vector3d& origin,
                                                const Eigen::Vector3d& direction, double t_min) const;
  // Outward unit normal at a point of the surface.
  [[nodiscard]] Eigen::Vector3d Normal(const Eigen::Vector3d& p) const;
  [[nodiscard]] Eigen::AlignedBox3d Bounds() const;
};

// From a to b. `side` is the direction along which the cross section is stretched by `stretch_side` (made
// perpendicular to the axis); the third axis is stretched by `stretch_front`. The ends stay round along the
// axis.
RoundCone MakeRoundCone(const Eigen::Vector3d& a, const Eigen::Vector3d& b, double radius_a_m,
                        double radius_b_m, const Eigen::Vector3d& side = Eigen::Vector3d::UnitX(),
                        double stretch_side = 1, double stretch_front = 1);

// Half axes along the columns of `axes` (a rotation).
RoundCone MakeEllipsoid(const Eigen::Vector3d& center, const Eigen::Matrix3d& axes,
                        const Eigen::Vector3d& half_axes_m);

}  // namespace mixstage
