// SPDX-License-Identifier: Apache-2.0
//
// The room around one point as a picture (MixIn3D 2.3): a sphere or an upright cylinder rolled out. Axes are
// the world's; azimuth is counted from +x over +y (counter-clockwise from above), elevation from the
// horizontal up.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "proto/base/result.h"

namespace mixstage {

enum class PanoramaShape {
  kSpherical = 1,  // rows are equal steps of elevation
  kCylindrical,    // rows are equal steps of tan(elevation): upright lines stay straight, no zenith, no nadir
};

// Where an elevation stands along the rows' axis: itself, or its tangent.
[[nodiscard]] double PanoramaLevel(PanoramaShape shape, double elevation_rad);

// Pixel centres are integers: column u looks to azimuth_left - (u + 0.5) (azimuth_left - azimuth_right) /
// width, row v to top - (v + 0.5) (top - bottom) / height, in elevation or its tangent. Columns run to the
// right as one who stands inside sees them.
struct Panorama {
  static constexpr int kMostSide = 8192;  // px

  PanoramaShape shape = PanoramaShape::kSpherical;
  int width = 0, height = 0;                                  // px
  Eigen::Vector3d center = Eigen::Vector3d::Zero();           // in the world
  double azimuth_left_deg = 180, azimuth_right_deg = -180;    // left > right, at most 360 apart
  double elevation_top_deg = 90, elevation_bottom_deg = -90;  // top > bottom; a cylinder's within +-80

  // Fails (kBadInput, the field named) unless all of that holds and the picture has at most 2^25 pixels.
  [[nodiscard]] Status Validate() const;

  // Unit vector in the world from center through (u, v) px, also between pixels.
  [[nodiscard]] Eigen::Vector3d Ray(double u, double v) const;
  // The pixel of a direction in the world; nothing outside the picture's edges and for length 0.
  [[nodiscard]] std::optional<Eigen::Vector2d> Pixel(const Eigen::Vector3d& direction) const;

  bool operator==(const Panorama&) const = default;
};

}  // namespace mixstage
