// SPDX-License-Identifier: Apache-2.0
//
// A camera model as a list of numbers that an adjustment may change, and its projection for any number type
// (doubles, Ceres' jets). Models: proto/geometry/camera_model.h.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "proto/geometry/camera_model.h"

namespace mixstage {

enum class LensKind {
  kPinhole = 1,  // fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6
  kFisheye,      // fx fy cx cy k1 k2 k3 k4
};

inline constexpr int kLensNumbers = 12;  // behind a fisheye's 8 come zeros

struct Lens {
  LensKind kind = LensKind::kPinhole;
  int width = 0, height = 0;  // px
  std::array<double, kLensNumbers> numbers{};
  double max_angle_rad = 0;    // fisheye
  std::vector<int> free = {};  // which numbers an adjustment estimates, rising

  [[nodiscard]] std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& p_camera) const;
  // Unit ray.
  [[nodiscard]] std::optional<Eigen::Vector3d> Unproject(const Eigen::Vector2d& pixel) const;
  [[nodiscard]] bool Sees(const Eigen::Vector2d& pixel, double border_px = 0) const {
    return pixel.x() >= border_px && pixel.y() >= border_px && pixel.x() <= width - 1 - border_px &&
           pixel.y() <= height - 1 - border_px;
  }
};

// k1, k2 are estimated beside focal lengths and principal point; what else the camera states stays as it is.
[[nodiscard]] Lens LensOf(const PinholeCamera& camera);
// All eight numbers are estimated.
[[nodiscard]] Lens LensOf(const FisheyeCamera& camera);
[[nodiscard]] PinholeCamera PinholeOf(const Lens& lens);
[[nodiscard]] FisheyeCamera FisheyeOf(const Lens& lens);

// Name of a number: "fx", "k2".
[[nodiscard]] const char* LensNumberName(LensKind kind, int index);

// Projects without asking whether the lens sees the point: the caller knows (an adjustment's points are in
// the picture).
template <typename T>
void ProjectThrough(LensKind kind, const T* n, const T* p, T* pixel) {
  using std::atan2;
  using std::sqrt;
  if (kind == LensKind::kPinhole) {
    const T x = p[0] / p[2];
    const T y = p[1] / p[2];
    const T r2 = x * x + y * y;
    const T g =
        (T(1) + r2 * (n[4] + r2 * (n[5] + r2 * n[8]))) / (T(1) + r2 * (n[9] + r2 * (n[10] + r2 * n[11])));
    pixel[0] = n[0] * (x * g + T(2) * n[6] * x * y + n[7] * (r2 + T(2) * x * x)) + n[2];
    pixel[1] = n[1] * (y * g + n[6] * (r2 + T(2) * y * y) + T(2) * n[7] * x * y) + n[3];
    return;
  }
  const T rho2 = p[0] * p[0] + p[1] * p[1];
  if (rho2 < T(1e-24)) {
    pixel[0] = n[0] * p[0] / p[2] + n[2];
    pixel[1] = n[1] * p[1] / p[2] + n[3];
    return;
  }
  const T rho = sqrt(rho2);
  const T theta = atan2(rho, p[2]);
  const T t2 = theta * theta;
  const T s = theta * (T(1) + t2 * (n[4] + t2 * (n[5] + t2 * (n[6] + t2 * n[7])))) / rho;
  pixel[0] = n[0] * s * p[0] + n[2];
  pixel[1] = n[1] * s * p[1] + n[3];
}

}  // namespace mixstage
