// SPDX-License-Identifier: Apache-2.0
//
// A panorama's projection by tables, for whole pictures: rays of its pixels, and pixels also beyond its
// edges.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "server/environment/panorama.h"

namespace mixstage {

class PanoramaGrid {
 public:
  explicit PanoramaGrid(const Panorama& panorama);

  [[nodiscard]] const Panorama& panorama() const { return panorama_; }
  [[nodiscard]] int width() const { return panorama_.width; }
  [[nodiscard]] int height() const { return panorama_.height; }
  // The left and the right edge are the same direction.
  [[nodiscard]] bool closed() const { return closed_; }
  // Columns of a whole turn.
  [[nodiscard]] double turn_px() const { return turn_px_; }

  // Unit vector in the world through a pixel's centre.
  [[nodiscard]] Eigen::Vector3f Ray(int x, int y) const {
    const float level = cos_elevation_[static_cast<std::size_t>(y)];
    return {level * cos_azimuth_[static_cast<std::size_t>(x)],
            level * sin_azimuth_[static_cast<std::size_t>(x)], sin_elevation_[static_cast<std::size_t>(y)]};
  }
  // Pixel of a direction, inside or not; of the columns that are a turn apart the one nearest to u_near.
  [[nodiscard]] Eigen::Vector2d PixelNear(const Eigen::Vector3d& direction, double u_near) const;
  // The column inside the picture for one that may be turns away; -1 = none.
  [[nodiscard]] int Column(int x) const {
    if (x >= 0 && x < panorama_.width) return x;
    if (!closed_) return -1;
    const int turned = x % panorama_.width;
    return turned < 0 ? turned + panorama_.width : turned;
  }
  // Radians between two rows and between two columns at the horizon.
  [[nodiscard]] double step_rad() const { return step_rad_; }

 private:
  Panorama panorama_;
  bool closed_ = false;
  double turn_px_ = 0, step_rad_ = 0;
  double left_rad_ = 0, columns_per_rad_ = 0, top_ = 0, rows_per_level_ = 0;
  std::vector<float> cos_azimuth_, sin_azimuth_, cos_elevation_, sin_elevation_;
};

}  // namespace mixstage
