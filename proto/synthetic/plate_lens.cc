// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/plate_lens.h"

#include <algorithm>
#include <numbers>

namespace mixstage {

using Eigen::Vector2d;
using Eigen::Vector3d;

PlateLens ColorLens(const Rig& rig) {
  const PinholeCamera camera = rig.color;
  const double half_diagonal2 = 0.25 * (static_cast<double>(camera.width) * camera.width +
                                        static_cast<double>(camera.height) * camera.height);
  PlateLens lens{.width = camera.width, .height = camera.height, .ray = {}, .gain = {}};
  lens.ray = [camera](const Vector2d& pixel) -> std::optional<Vector3d> {
    const auto n = camera.Unproject(pixel);
    if (!n) return std::nullopt;
    return Vector3d(n->x(), n->y(), 1);
  };
  lens.gain = [camera, half_diagonal2, a = rig.vignetting_a, b = rig.vignetting_b](const Vector2d& pixel) {
    const double r2 = (pixel - Vector2d(camera.cx, camera.cy)).squaredNorm() / half_diagonal2;
    return std::max(0.0, 1 + a * r2 + b * r2 * r2);
  };
  return lens;
}

PlateLens FisheyeLens(const FisheyeCamera& camera) {
  // Rays go a little beyond the circle: pixels on its rim see what lies around them.
  constexpr double kBeyond_rad = 0.05;
  FisheyeCamera wide = camera;
  wide.max_angle_rad = std::min(camera.max_angle_rad + kBeyond_rad, std::numbers::pi);
  PlateLens lens{.width = camera.width, .height = camera.height, .ray = {}, .gain = {}};
  lens.ray = [wide](const Vector2d& pixel) { return wide.Unproject(pixel); };
  lens.gain = [camera](const Vector2d& pixel) { return camera.Unproject(pixel) ? 1.0 : 0.0; };
  return lens;
}

}  // namespace mixstage
