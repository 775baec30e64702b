// SPDX-License-Identifier: Apache-2.0
//
// Camera models: points of a camera's frame to pixels and back. algorithms: OpenCV's pinhole with the
// rational distortion (k1..k6, p1, p2) and Kannala-Brandt for the fisheye (angles beyond 90 degrees from the
// axis).
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "proto/base/result.h"

namespace mixstage {

struct PinholeCamera {
  int width = 0, height = 0;  // px
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0;

  // Fails unless sizes are in 1..8192, every number is finite and fx, fy > 0; names the field.
  Status Validate() const;

  // Undistorted normalised coordinates (x/z, y/z) to distorted ones and to pixels.
  [[nodiscard]] Eigen::Vector2d Distort(const Eigen::Vector2d& normalised) const;
  [[nodiscard]] Eigen::Vector2d ProjectNormalised(const Eigen::Vector2d& normalised) const;
  // Nothing for z <= 0 and for directions beyond the angle where the distortion polynomial folds back.
  [[nodiscard]] std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& p_camera) const;

  // Pixel to (x/z, y/z) by Newton's method; nothing where it does not converge to 1e-9 (beyond the fold).
  [[nodiscard]] std::optional<Eigen::Vector2d> Unproject(const Eigen::Vector2d& pixel) const;

  // Square of the largest undistorted radius for which the radial distortion still grows.
  [[nodiscard]] double FoldRadiusSquared() const;

  bool operator==(const PinholeCamera&) const = default;
};

// [h x w] (x/z, y/z) of every pixel centre, NaN where a pixel has no ray. Computed once per camera.
[[nodiscard]] cv::Mat2f UnprojectionTable(const PinholeCamera& camera);

// Kannala-Brandt: r = f (theta + k1 theta^3 + k2 theta^5 + k3 theta^7 + k4 theta^9), theta = angle from the
// axis.
struct FisheyeCamera {
  int width = 0, height = 0;  // px
  double fx = 0, fy = 0, cx = 0, cy = 0;
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0;
  double max_angle_rad = 1.6580627893946132;  // 95 degrees; rays beyond it have no pixel

  Status Validate() const;
  [[nodiscard]] std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& p_camera) const;
  // Unit ray of a pixel; nothing beyond max_angle_rad.
  [[nodiscard]] std::optional<Eigen::Vector3d> Unproject(const Eigen::Vector2d& pixel) const;

  bool operator==(const FisheyeCamera&) const = default;
};

}  // namespace mixstage
