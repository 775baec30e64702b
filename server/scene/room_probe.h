// SPDX-License-Identifier: Apache-2.0
//
// What editing has to know about the real room: where pixels of the colour picture lie in it.
#pragma once

#include <Eigen/Core>
#include <optional>

namespace mixstage {

// Pixels are those of the colour camera's distorted picture, points and directions in the scene's frame.
class RoomProbe {
 public:
  virtual ~RoomProbe() = default;

  struct Ray {
    Eigen::Vector3d origin = Eigen::Vector3d::Zero();
    Eigen::Vector3d direction = Eigen::Vector3d::Zero();  // of any length > 0
  };
  // Nothing outside the picture and where the lens has no ray.
  [[nodiscard]] virtual std::optional<Ray> RayThrough(double u, double v) const = 0;
  // The empty room's surface under a pixel; nothing where its depth is not known.
  [[nodiscard]] virtual std::optional<Eigen::Vector3d> SurfaceUnder(double u, double v) const = 0;
  // Height (along up) of the highest surface of the empty room not above base, within radius_m of the
  // vertical through it; nothing where the room was not seen there.
  [[nodiscard]] virtual std::optional<double> HighestSurfaceBelow(const Eigen::Vector3d& base,
                                                                  double radius_m) const = 0;
};

}  // namespace mixstage
