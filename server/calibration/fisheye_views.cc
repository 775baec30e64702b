// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/fisheye_views.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

namespace mixstage {

std::vector<FisheyeView> ViewsAround(const FisheyeCamera& camera) {
  constexpr double kRad = std::numbers::pi / 180;
  constexpr double kHalfField = 40 * kRad;
  FisheyeView shape;
  // As fine in its centre as the fisheye is on its axis, and finer outwards; detectors want larger squares.
  shape.focal_px = 1.5 * camera.fx;
  shape.side_px = static_cast<int>(2 * shape.focal_px * std::tan(kHalfField));
  std::vector<FisheyeView> views;
  auto add = [&](double theta, double phi) {
    FisheyeView v = shape;
    const Eigen::Vector3d z(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi),
                            std::cos(theta));
    const Eigen::Vector3d x = Eigen::Vector3d::UnitY().cross(z).normalized();
    v.R_fisheye_view << x, z.cross(x), z;
    views.push_back(v);
  };
  add(0, 0);
  for (const auto& [theta, count] : {std::pair{40, 6}, std::pair{72, 10}}) {
    if (theta * kRad > camera.max_angle_rad) break;
    for (int i = 0; i < count; ++i) add(theta * kRad, 2 * std::numbers::pi * i / count);
  }
  return views;
}

std::optional<Eigen::Vector2d> ToFisheye(const FisheyeCamera& camera, const FisheyeView& view,
                                         const Eigen::Vector2d& pixel) {
  const double centre = 0.5 * (view.side_px - 1);
  const Eigen::Vector3d ray((pixel.x() - centre) / view.focal_px, (pixel.y() - centre) / view.focal_px, 1);
  const auto p = camera.Project(view.R_fisheye_view * ray);
  if (!p || p->x() < 0 || p->y() < 0 || p->x() > camera.width - 1 || p->y() > camera.height - 1)
    return std::nullopt;
  return p;
}

cv::Mat1b DrawView(const cv::Mat1b& fisheye, const FisheyeCamera& camera, const FisheyeView& view) {
  cv::Mat2f map(view.side_px, view.side_px);
  for (int v = 0; v < view.side_px; ++v) {
    for (int u = 0; u < view.side_px; ++u) {
      const auto p = ToFisheye(camera, view, {u, v});
      map(v, u) = p ? cv::Vec2f(static_cast<float>(p->x()), static_cast<float>(p->y())) : cv::Vec2f(-10, -10);
    }
  }
  cv::Mat1b out;
  cv::remap(fisheye, out, map, cv::noArray(), cv::INTER_CUBIC, cv::BORDER_CONSTANT, cv::Scalar(0));
  return out;
}

}  // namespace mixstage
