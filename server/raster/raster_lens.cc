// SPDX-License-Identifier: Apache-2.0
#include "server/raster/raster_lens.h"

#include <algorithm>
#include <cmath>

#include "proto/base/check.h"

namespace mixstage::raster {
namespace {

constexpr double kChordErrorPx = 0.05;
constexpr float kLargestMetres =
    1e6f;  // farther corners lose their pixels to rounding; NaN fails the test too
constexpr float kLargestPx = 65536.0f;  // coordinates beyond it do not fit the scan's fixed point

// FoldRadiusSquared walks in steps and returns the first that folds: here the border itself, from the safe
// side.
double PreciseFoldRadiusSquared(const PinholeCamera& camera) {
  const double outside = camera.FoldRadiusSquared();
  double low = std::max(0.0, (outside - 0.005) / 1.01 - 1e-9);
  double high = outside;
  auto has_pixel = [&](double r2) {
    return camera.Project(Eigen::Vector3d(std::sqrt(r2), 0, 1)).has_value();
  };
  if (has_pixel(high)) return high;
  if (!has_pixel(low)) low = 0;
  for (int i = 0; i < 50; ++i) {
    const double middle = 0.5 * (low + high);
    (has_pixel(middle) ? low : high) = middle;
  }
  return low;
}

struct ViewBounds {
  double x0 = 0, x1 = 0, y0 = 0, y1 = 0, radius = 0;
};

// Undistorted outline of the picture. Where its border has no ray, the fold is the border.
ViewBounds BoundsOf(const PinholeCamera& camera, double fold_r2) {
  ViewBounds view;
  bool all_seen = true;
  auto visit = [&](double u, double v) {
    const auto ray = camera.Unproject(Eigen::Vector2d(u, v));
    if (!ray) {
      all_seen = false;
      return;
    }
    view.x0 = std::min(view.x0, ray->x());
    view.x1 = std::max(view.x1, ray->x());
    view.y0 = std::min(view.y0, ray->y());
    view.y1 = std::max(view.y1, ray->y());
    view.radius = std::max(view.radius, ray->norm());
  };
  constexpr int kSteps = 64;
  for (int i = 0; i <= kSteps; ++i) {
    const double u = -0.5 + camera.width * i / double{kSteps};
    const double v = -0.5 + camera.height * i / double{kSteps};
    visit(u, -0.5);
    visit(u, camera.height - 0.5);
    visit(-0.5, v);
    visit(camera.width - 0.5, v);
  }
  if (!all_seen) {
    const double fold = std::sqrt(fold_r2);
    return {-fold, fold, -fold, fold, fold};
  }
  // Between the samples the outline bulges by less than this share of the view.
  const double margin_x = 0.01 * (view.x1 - view.x0);
  const double margin_y = 0.01 * (view.y1 - view.y0);
  return {view.x0 - margin_x, view.x1 + margin_x, view.y0 - margin_y, view.y1 + margin_y, view.radius};
}

// Largest second derivative of the distortion inside the view: a chord of length h (normalised) leaves its
// curve by h^2 / 8 times this.
double CurvatureOf(const PinholeCamera& camera, double radius) {
  constexpr int kSteps = 100;
  const double h = std::max(radius, 1e-3) / kSteps;
  double largest = 0;
  for (int i = 1; i < kSteps; ++i) {
    const double r = i * h;
    for (const auto& [direction, across] : {std::pair{Eigen::Vector2d(1, 0), Eigen::Vector2d(0, 1)},
                                            std::pair{Eigen::Vector2d(0, 1), Eigen::Vector2d(1, 0)}}) {
      const Eigen::Vector2d at = camera.Distort(r * direction);
      const Eigen::Vector2d along_second =
          camera.Distort((r + h) * direction) - 2 * at + camera.Distort((r - h) * direction);
      const Eigen::Vector2d across_second =
          camera.Distort(r * direction + h * across) - 2 * at + camera.Distort(r * direction - h * across);
      largest = std::max({largest, along_second.norm() / (h * h), across_second.norm() / (h * h)});
    }
  }
  return largest;
}

}  // namespace

RasterLens RasterLens::Of(const PinholeCamera& picture, double near_m) {
  RasterLens lens;
  const double fold_r2 = PreciseFoldRadiusSquared(picture);
  const ViewBounds view = BoundsOf(picture, fold_r2);
  lens.fold_r2 = static_cast<float>(fold_r2);
  lens.view_x0 = static_cast<float>(view.x0);
  lens.view_x1 = static_cast<float>(view.x1);
  lens.view_y0 = static_cast<float>(view.y0);
  lens.view_y1 = static_cast<float>(view.y1);
  const double focal = std::max(picture.fx, picture.fy);
  const double curvature = CurvatureOf(picture, view.radius);
  const double edge_px =
      curvature > 1e-9 ? std::sqrt(8 * kChordErrorPx * focal / curvature) : double{kMaxEdgePx};
  lens.max_edge = static_cast<std::int32_t>(std::clamp(edge_px, 4.0, double{kMaxEdgePx}) * kSubPixels);
  lens.near_m = static_cast<float>(near_m);
  return lens.OnGrid(picture, 1);
}

RasterLens RasterLens::OnGrid(const PinholeCamera& camera, int scale) const {
  MIX_CHECK(scale >= 1);
  RasterLens lens = *this;
  auto narrow = [](double v) { return static_cast<float>(v); };
  lens.fx = narrow(camera.fx), lens.fy = narrow(camera.fy), lens.cx = narrow(camera.cx),
  lens.cy = narrow(camera.cy);
  lens.k1 = narrow(camera.k1), lens.k2 = narrow(camera.k2), lens.k3 = narrow(camera.k3);
  lens.k4 = narrow(camera.k4), lens.k5 = narrow(camera.k5), lens.k6 = narrow(camera.k6);
  lens.p1 = narrow(camera.p1), lens.p2 = narrow(camera.p2);
  lens.max_edge = std::min(max_edge * scale, kMaxEdgePx * kSubPixels);
  return lens;
}

ProjectedVertex RasterLens::Project(const Eigen::Vector3f& p) const {
  ProjectedVertex v;
  const float x = p.x();
  const float y = p.y();
  const float z = p.z();
  if (!(std::abs(x) < kLargestMetres && std::abs(y) < kLargestMetres && std::abs(z) < kLargestMetres)) {
    v.outcode = kNotFinite;
    return v;
  }
  // Half spaces through the camera's centre: right in front of it and behind it.
  if (x < view_x0 * z) v.outcode |= kLeft;
  if (x > view_x1 * z) v.outcode |= kRight;
  if (y < view_y0 * z) v.outcode |= kAbove;
  if (y > view_y1 * z) v.outcode |= kBelow;
  if (z < near_m) {
    v.outcode |= kNear;
    return v;
  }
  v.inverse_z = 1.0f / z;
  const float nx = x * v.inverse_z;
  const float ny = y * v.inverse_z;
  const float r2 = nx * nx + ny * ny;
  const float numerator = 1.0f + r2 * (k1 + r2 * (k2 + r2 * k3));
  const float denominator = 1.0f + r2 * (k4 + r2 * (k5 + r2 * k6));
  const float g = numerator / denominator;
  const float two_xy = 2.0f * (nx * ny);
  const float dx = nx * g + (p1 * two_xy + p2 * (r2 + 2.0f * (nx * nx)));
  const float dy = ny * g + (p1 * (r2 + 2.0f * (ny * ny)) + p2 * two_xy);
  const float u = fx * dx + cx;
  const float w = fy * dy + cy;
  if (!(r2 < fold_r2 && std::abs(u) < kLargestPx && std::abs(w) < kLargestPx)) {
    v.outcode |= kNoPixel;
    return v;
  }
  v.x = static_cast<std::int32_t>(std::nearbyint(u * float{kSubPixels}));
  v.y = static_cast<std::int32_t>(std::nearbyint(w * float{kSubPixels}));
  return v;
}

Affine34 Affine34::Of(const Eigen::Affine3d& T) {
  Affine34 rows;
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 4; ++c) rows.m[r][c] = static_cast<float>(T.matrix()(r, c));
  }
  return rows;
}

void RasterLens::CutOff(const Affine34& T_camera_object, std::span<const Eigen::Vector3f> positions,
                        std::span<ProjectedVertex> projected) const {
  if (!cuts()) return;
  MIX_CHECK(positions.size() == projected.size());
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!(Height(T_camera_object * positions[i]) >= 0)) projected[i].outcode |= kCutOff;
  }
}

void ProjectVerticesScalar(const RasterLens& lens, const Affine34& T_camera_object,
                           std::span<const Eigen::Vector3f> positions, std::span<ProjectedVertex> out) {
  MIX_CHECK(positions.size() == out.size());
  for (std::size_t i = 0; i < positions.size(); ++i) out[i] = lens.Project(T_camera_object * positions[i]);
}

}  // namespace mixstage::raster
