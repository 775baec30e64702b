// SPDX-License-Identifier: Apache-2.0
#include "server/environment/sweep_layout.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;
constexpr double kMargin_deg = 1.0;
constexpr double kFiner = 1 / 0.6;  // panorama pixels for each of the colour camera's, in its middle
constexpr double kMostPixels = 1 << 25;

}  // namespace

Panorama LayOutPanorama(const PinholeCamera& color, const std::vector<RigidTransform>& T_world_color,
                        int divisor) {
  MIX_CHECK(!T_world_color.empty() && divisor >= 1);
  Panorama p;
  p.center.setZero();
  Eigen::Vector2d heading = Eigen::Vector2d::Zero();
  for (const RigidTransform& T : T_world_color) {
    p.center += T.translation() / static_cast<double>(T_world_color.size());
    heading += T.linear().col(2).head<2>();
  }
  const double middle_deg = heading.norm() > 1e-6 ? std::atan2(heading.y(), heading.x()) * kDegPerRad : 0;
  double left = -1e9, right = 1e9, top = -90, bottom = 90;
  bool turn = false;
  constexpr int kSteps = 24;
  for (const RigidTransform& T : T_world_color) {
    for (int side = 0; side < 4; ++side) {
      for (int k = 0; k < kSteps; ++k) {
        const double s = static_cast<double>(k) / kSteps;
        const double along_x = s * (color.width - 1), along_y = s * (color.height - 1);
        const Eigen::Vector2d pixel = side == 0   ? Eigen::Vector2d(along_x, 0)
                                      : side == 1 ? Eigen::Vector2d(color.width - 1, along_y)
                                      : side == 2
                                          ? Eigen::Vector2d(color.width - 1 - along_x, color.height - 1)
                                          : Eigen::Vector2d(0, color.height - 1 - along_y);
        const auto n = color.Unproject(pixel);
        if (!n) continue;
        const Eigen::Vector3d ray = T.linear() * Eigen::Vector3d(n->x(), n->y(), 1);
        double off = std::atan2(ray.y(), ray.x()) * kDegPerRad - middle_deg;
        off -= 360 * std::round(off / 360);
        left = std::max(left, off);
        right = std::min(right, off);
        const double elevation = std::atan2(ray.z(), std::hypot(ray.x(), ray.y())) * kDegPerRad;
        top = std::max(top, elevation);
        bottom = std::min(bottom, elevation);
      }
    }
    // Straight up or down in the picture: every azimuth is.
    for (const double up : {1.0, -1.0}) {
      const auto pole = color.Project(T.linear().transpose() * Eigen::Vector3d(0, 0, up));
      if (!pole || pole->x() < 0 || pole->y() < 0 || pole->x() > color.width - 1 ||
          pole->y() > color.height - 1)
        continue;
      turn = true;
      (up > 0 ? top : bottom) = 90 * up;
    }
  }
  left = std::min(left + kMargin_deg, 180.0);
  right = std::max(right - kMargin_deg, -180.0);
  if (turn || left - right > 350) {
    left = 180;
    right = -180;
  }
  p.azimuth_left_deg = middle_deg + left;
  p.azimuth_right_deg = middle_deg + right;
  p.elevation_top_deg = std::min(top + kMargin_deg, 90.0);
  p.elevation_bottom_deg = std::max(bottom - kMargin_deg, -90.0);
  const double across = p.azimuth_left_deg - p.azimuth_right_deg;
  const double down = p.elevation_top_deg - p.elevation_bottom_deg;
  double per_deg = kFiner * color.fx / kDegPerRad;
  per_deg =
      std::min({per_deg, (Panorama::kMostSide - divisor) / across, (Panorama::kMostSide - divisor) / down,
                std::sqrt(0.95 * kMostPixels / (across * down))});
  auto pixels = [&](double deg) {
    return std::max(divisor, static_cast<int>(std::ceil(deg * per_deg / divisor)) * divisor);
  };
  p.width = pixels(across);
  p.height = pixels(down);
  return p;
}

Panorama Coarser(const Panorama& panorama, int times) {
  MIX_CHECK(times >= 1 && panorama.width % times == 0 && panorama.height % times == 0);
  Panorama p = panorama;
  p.width /= times;
  p.height /= times;
  return p;
}

}  // namespace mixstage
