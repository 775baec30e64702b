// SPDX-License-Identifier: Apache-2.0
#include "server/environment/panorama_grid.h"

#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;

}  // namespace

PanoramaGrid::PanoramaGrid(const Panorama& panorama) : panorama_(panorama) {
  const Panorama& p = panorama_;
  const double across_rad = (p.azimuth_left_deg - p.azimuth_right_deg) * kRadPerDeg;
  closed_ = across_rad > 2 * std::numbers::pi - 1e-6;
  left_rad_ = p.azimuth_left_deg * kRadPerDeg;
  columns_per_rad_ = p.width / across_rad;
  turn_px_ = 2 * std::numbers::pi * columns_per_rad_;
  step_rad_ = across_rad / p.width;
  top_ = PanoramaLevel(p.shape, p.elevation_top_deg * kRadPerDeg);
  rows_per_level_ = p.height / (top_ - PanoramaLevel(p.shape, p.elevation_bottom_deg * kRadPerDeg));
  for (int x = 0; x < p.width; ++x) {
    const double azimuth = left_rad_ - (x + 0.5) / columns_per_rad_;
    cos_azimuth_.push_back(static_cast<float>(std::cos(azimuth)));
    sin_azimuth_.push_back(static_cast<float>(std::sin(azimuth)));
  }
  for (int y = 0; y < p.height; ++y) {
    const double level = top_ - (y + 0.5) / rows_per_level_;
    const double elevation = p.shape == PanoramaShape::kSpherical ? level : std::atan(level);
    cos_elevation_.push_back(static_cast<float>(std::cos(elevation)));
    sin_elevation_.push_back(static_cast<float>(std::sin(elevation)));
  }
}

Eigen::Vector2d PanoramaGrid::PixelNear(const Eigen::Vector3d& direction, double u_near) const {
  const double level_length = std::hypot(direction.x(), direction.y());
  double u = (left_rad_ - std::atan2(direction.y(), direction.x())) * columns_per_rad_ - 0.5;
  u += turn_px_ * std::round((u_near - u) / turn_px_);
  const double level = panorama_.shape == PanoramaShape::kSpherical
                           ? std::atan2(direction.z(), level_length)
                           : direction.z() / std::max(level_length, 1e-9);
  return {u, (top_ - level) * rows_per_level_ - 0.5};
}

}  // namespace mixstage
