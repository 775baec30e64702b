// SPDX-License-Identifier: Apache-2.0
#include "server/environment/panorama.h"

#include <cmath>
#include <numbers>
#include <string>

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

}  // namespace

double PanoramaLevel(PanoramaShape shape, double elevation_rad) {
  return shape == PanoramaShape::kSpherical ? elevation_rad : std::tan(elevation_rad);
}

Status Panorama::Validate() const {
  auto bad = [](const std::string& what) { return Fail(ErrorCode::kBadInput, what); };
  if (shape != PanoramaShape::kSpherical && shape != PanoramaShape::kCylindrical)
    return bad("projection is neither spherical nor cylindrical");
  if (width < 1 || width > kMostSide) return bad("width is not in 1..8192 px");
  if (height < 1 || height > kMostSide) return bad("height is not in 1..8192 px");
  if (width * height > (1 << 25)) return bad("width x height is over 2^25 px");
  if (!center.allFinite() || center.cwiseAbs().maxCoeff() > 1e4) return bad("center is not within 10 km");
  const double across = azimuth_left_deg - azimuth_right_deg;
  if (!(std::abs(azimuth_left_deg) <= 720 && std::abs(azimuth_right_deg) <= 720 && across > 0 &&
        across <= 360 + 1e-9)) {
    return bad("azimuth_left_deg is not 0 to 360 degrees more than azimuth_right_deg");
  }
  const double most = shape == PanoramaShape::kSpherical ? 90 : 80;
  if (!(elevation_top_deg > elevation_bottom_deg && elevation_top_deg <= most &&
        elevation_bottom_deg >= -most)) {
    return bad("elevation_top_deg and elevation_bottom_deg do not fall from at most " +
               std::to_string(static_cast<int>(most)) + " to at least -" +
               std::to_string(static_cast<int>(most)) + " degrees");
  }
  return {};
}

Eigen::Vector3d Panorama::Ray(double u, double v) const {
  const double azimuth =
      (azimuth_left_deg - (u + 0.5) / width * (azimuth_left_deg - azimuth_right_deg)) * kRadPerDeg;
  const double top = PanoramaLevel(shape, elevation_top_deg * kRadPerDeg);
  const double bottom = PanoramaLevel(shape, elevation_bottom_deg * kRadPerDeg);
  const double level = top - (v + 0.5) / height * (top - bottom);
  const double elevation = shape == PanoramaShape::kSpherical ? level : std::atan(level);
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

std::optional<Eigen::Vector2d> Panorama::Pixel(const Eigen::Vector3d& direction) const {
  const double level_length = std::hypot(direction.x(), direction.y());
  if (!(level_length > 0 || std::abs(direction.z()) > 0) || !direction.allFinite()) return std::nullopt;
  // The turn at which an azimuth is counted: from the right edge on, up to one whole turn.
  double past_right = std::atan2(direction.y(), direction.x()) / kRadPerDeg - azimuth_right_deg;
  past_right -= 360 * std::floor(past_right / 360);
  const double across = azimuth_left_deg - azimuth_right_deg;
  const double u = (across - past_right) / across * width - 0.5;
  const double elevation = std::atan2(direction.z(), level_length);
  if (shape == PanoramaShape::kCylindrical && !(level_length > 0)) return std::nullopt;
  const double top = PanoramaLevel(shape, elevation_top_deg * kRadPerDeg);
  const double bottom = PanoramaLevel(shape, elevation_bottom_deg * kRadPerDeg);
  const double v = (top - PanoramaLevel(shape, elevation)) / (top - bottom) * height - 0.5;
  if (!(u >= -0.5 && u <= width - 0.5 && v >= -0.5 && v <= height - 0.5)) return std::nullopt;
  return Eigen::Vector2d(u, v);
}

}  // namespace mixstage
