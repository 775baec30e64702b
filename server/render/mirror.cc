// SPDX-License-Identifier: Apache-2.0
#include "server/render/mirror.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "proto/geometry/half_camera.h"

namespace mixstage {
namespace {

constexpr double kInPlane_m = 0.01;
constexpr double kNear_m = 0.05;
constexpr int kEdgeSteps = 16;  // the lens bends an edge between them by less than the margin
constexpr double kMargin_px = 3;

}  // namespace

PinholeCamera MirroredCamera(const PinholeCamera& color) {
  PinholeCamera half = HalfCamera(color);
  half.cx = half.width - 1 - half.cx;
  half.p2 = -color.p2;  // the one term of the lens that is odd in x
  return half;
}

std::optional<MirrorView> ViewInto(const Reflector& reflector, const RigidTransform& T_scene_color) {
  MirrorView view;
  view.plane = reflector.plane;
  const double height = view.plane.head<3>().dot(T_scene_color.translation()) + view.plane.w();
  if (!(std::abs(height) > kInPlane_m)) return std::nullopt;
  if (height < 0) view.plane = -view.plane;
  const Eigen::Vector3d n = view.plane.head<3>();
  const Eigen::Matrix3d mirror = Eigen::Matrix3d::Identity() - 2 * n * n.transpose();
  view.T_scene_mirrored.linear() =
      mirror * T_scene_color.linear() * Eigen::Vector3d(-1, 1, 1).asDiagonal().toDenseMatrix();
  view.T_scene_mirrored.translation() = T_scene_color.translation() - 2 * std::abs(height) * n;
  return view;
}

cv::Rect WindowOf(const Reflector& reflector, const RigidTransform& T_scene_color,
                  const PinholeCamera& color) {
  const cv::Rect picture(0, 0, (color.width + 1) / 2, (color.height + 1) / 2);
  if (reflector.polygon.empty()) return picture;
  const RigidTransform T_color_scene = T_scene_color.inverse();
  std::vector<Eigen::Vector3d> corners;
  for (const Eigen::Vector3d& corner : reflector.polygon) corners.push_back(T_color_scene * corner);
  Eigen::Array2d low = Eigen::Array2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Array2d high = -low;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    Eigen::Vector3d a = corners[i], b = corners[(i + 1) % corners.size()];
    if (a.z() < kNear_m && b.z() < kNear_m) continue;
    if (a.z() < kNear_m) std::swap(a, b);
    if (b.z() < kNear_m) b = a + (a.z() - kNear_m) / (a.z() - b.z()) * (b - a);
    for (int k = 0; k <= kEdgeSteps; ++k) {
      const double share = static_cast<double>(k) / kEdgeSteps;
      // Even steps in the picture.
      const Eigen::Vector3d p =
          (share * a * b.z() + (1 - share) * b * a.z()) / (share * b.z() + (1 - share) * a.z());
      const auto pixel = color.Project(p);
      if (!pixel) return picture;
      low = low.min(pixel->array());
      high = high.max(pixel->array());
    }
  }
  if (!(low.x() <= high.x())) return {};
  const auto half = [](double pixel, double limit) {
    return static_cast<int>(std::clamp(pixel / 2, 0.0, limit));
  };
  low -= kMargin_px;
  high += kMargin_px;
  if (high.x() < 0 || high.y() < 0 || low.x() >= color.width || low.y() >= color.height) return {};
  const int x = half(low.x(), picture.width - 1), y = half(low.y(), picture.height - 1);
  return {x, y, half(high.x(), picture.width - 1) + 1 - x, half(high.y(), picture.height - 1) + 1 - y};
}

PolygonTest::PolygonTest(const Reflector& reflector) {
  int along = 0;
  reflector.plane.head<3>().cwiseAbs().maxCoeff(&along);
  first_ = (along + 1) % 3;
  second_ = (along + 2) % 3;
  const Eigen::Vector3d normal = reflector.plane.head<3>();
  for (const Eigen::Vector3d& corner : reflector.polygon) {
    const Eigen::Vector3d p = corner - (normal.dot(corner) + reflector.plane.w()) * normal;
    corners_.emplace_back(static_cast<float>(p[first_]), static_cast<float>(p[second_]));
  }
}

bool PolygonTest::Contains(const Eigen::Vector3f& point) const {
  if (corners_.empty()) return true;
  const float x = point[first_], y = point[second_];
  bool inside = false;
  for (std::size_t i = 0, k = corners_.size() - 1; i < corners_.size(); k = i++) {
    const Eigen::Vector2f &a = corners_[i], &b = corners_[k];
    if ((a.y() > y) != (b.y() > y) && x < a.x() + (y - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
      inside = !inside;
  }
  return inside;
}

float Fresnel(double reflectivity, double roughness, float cosine) {
  if (!(reflectivity > 0)) return 0;
  const auto head_on = static_cast<float>(reflectivity);
  const float grazing = std::max(static_cast<float>(1 - roughness), head_on);
  const float rest = 1 - std::clamp(cosine, 0.0f, 1.0f);
  return head_on + (grazing - head_on) * rest * rest * rest * rest * rest;
}

}  // namespace mixstage
