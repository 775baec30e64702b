// SPDX-License-Identifier: Apache-2.0
//
// What a mesh covers of the picture it was made from, for tests: places of its vertices are taken from its
// texture coordinates.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>

#include "server/segmentation/picture_mesh.h"

namespace mixstage {

inline Eigen::Vector2d PixelOf(const PictureMesh& mesh, std::uint32_t vertex) {
  const Eigen::Vector2f& uv = mesh.uvs[vertex];
  return {static_cast<double>(uv.x()) * mesh.crop.width + mesh.crop.x - 0.5,
          static_cast<double>(uv.y()) * mesh.crop.height + mesh.crop.y - 0.5};
}

// Above 0: against the clock as a viewer of the picture (y down) sees it.
inline double SignedArea(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  return (b - a).y() * (c - a).x() - (b - a).x() * (c - a).y();
}

// 255 where a triangle covers the pixel's centre.
inline cv::Mat1b Coverage(const PictureMesh& mesh, cv::Size size) {
  cv::Mat1b covered(size, std::uint8_t{0});
  for (std::size_t t = 0; t < mesh.indices.size(); t += 3) {
    std::array<Eigen::Vector2d, 3> p;
    for (std::size_t k = 0; k < 3; ++k) p[k] = PixelOf(mesh, mesh.indices[t + k]);
    const auto [x0, x1] = std::minmax({p[0].x(), p[1].x(), p[2].x()});
    const auto [y0, y1] = std::minmax({p[0].y(), p[1].y(), p[2].y()});
    for (int y = static_cast<int>(std::ceil(y0 - 1e-3)); y <= std::min(size.height - 1.0, y1 + 1e-3); ++y) {
      for (int x = static_cast<int>(std::ceil(x0 - 1e-3)); x <= std::min(size.width - 1.0, x1 + 1e-3); ++x) {
        const Eigen::Vector2d here(x, y);
        bool inside = true;
        for (std::size_t k = 0; k < 3; ++k)
          inside = inside && SignedArea(p[k], p[(k + 1) % 3], here) >= -1e-3;
        if (inside) covered(y, x) = 255;
      }
    }
  }
  return covered;
}

}  // namespace mixstage
