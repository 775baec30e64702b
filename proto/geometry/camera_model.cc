// SPDX-License-Identifier: Apache-2.0
#include "proto/geometry/camera_model.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <utility>

namespace mixstage {
namespace {

Status CheckSizeAndFocal(int width, int height, double fx, double fy, double cx, double cy) {
  if (width < 1 || height < 1 || width > 8192 || height > 8192) {
    return Fail(ErrorCode::kBadInput, "width x height = " + std::to_string(width) + " x " +
                                          std::to_string(height) + " is outside 1..8192");
  }
  const std::pair<const char*, double> numbers[] = {{"fx", fx}, {"fy", fy}, {"cx", cx}, {"cy", cy}};
  for (const auto& [name, value] : numbers) {
    if (!std::isfinite(value)) return Fail(ErrorCode::kBadInput, std::string(name) + " is not finite");
  }
  if (fx <= 0) return Fail(ErrorCode::kBadInput, "fx must be > 0 (K is singular)");
  if (fy <= 0) return Fail(ErrorCode::kBadInput, "fy must be > 0 (K is singular)");
  return {};
}

// Radial factor g(r2) = N/D and its derivative with respect to r2.
std::pair<double, double> RadialFactor(const PinholeCamera& c, double r2) {
  const double n = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
  const double d = 1 + r2 * (c.k4 + r2 * (c.k5 + r2 * c.k6));
  const double dn = c.k1 + r2 * (2 * c.k2 + r2 * 3 * c.k3);
  const double dd = c.k4 + r2 * (2 * c.k5 + r2 * 3 * c.k6);
  return {n / d, (dn * d - n * dd) / (d * d)};
}

}  // namespace

Status PinholeCamera::Validate() const {
  if (auto ok = CheckSizeAndFocal(width, height, fx, fy, cx, cy); !ok) return ok;
  const std::pair<const char*, double> numbers[] = {{"k1", k1}, {"k2", k2}, {"p1", p1}, {"p2", p2},
                                                    {"k3", k3}, {"k4", k4}, {"k5", k5}, {"k6", k6}};
  for (const auto& [name, value] : numbers) {
    if (!std::isfinite(value)) return Fail(ErrorCode::kBadInput, std::string(name) + " is not finite");
  }
  return {};
}

Eigen::Vector2d PinholeCamera::Distort(const Eigen::Vector2d& p) const {
  const double r2 = p.squaredNorm();
  const double g = RadialFactor(*this, r2).first;
  return {p.x() * g + 2 * p1 * p.x() * p.y() + p2 * (r2 + 2 * p.x() * p.x()),
          p.y() * g + p1 * (r2 + 2 * p.y() * p.y()) + 2 * p2 * p.x() * p.y()};
}

Eigen::Vector2d PinholeCamera::ProjectNormalised(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d d = Distort(p);
  return {fx * d.x() + cx, fy * d.y() + cy};
}

double PinholeCamera::FoldRadiusSquared() const {
  // d/dr (r g(r^2)) = g + 2 r^2 g' must stay positive, and g itself too (a pole of the rational model turns
  // it); searched up to 84 degrees from the axis.
  constexpr double kLargest = 100.0;
  for (double r2 = 0.0; r2 < kLargest; r2 += 0.005 + 0.01 * r2) {
    const auto [g, dg] = RadialFactor(*this, r2);
    if (!(g + 2 * r2 * dg > 0) || !(g > 0)) return r2;
  }
  return kLargest;
}

std::optional<Eigen::Vector2d> PinholeCamera::Project(const Eigen::Vector3d& p) const {
  if (!(p.z() > 0)) return std::nullopt;
  const Eigen::Vector2d n = p.head<2>() / p.z();
  const double r2 = n.squaredNorm();
  const auto [g, dg] = RadialFactor(*this, r2);
  if (!(g + 2 * r2 * dg > 0) || !(g > 0)) return std::nullopt;
  return ProjectNormalised(n);
}

std::optional<Eigen::Vector2d> PinholeCamera::Unproject(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d target((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  Eigen::Vector2d p = target;
  for (int i = 0; i < 30; ++i) {
    const Eigen::Vector2d error = Distort(p) - target;
    if (error.norm() < 1e-12) break;
    const double r2 = p.squaredNorm();
    const auto [g, dg] = RadialFactor(*this, r2);
    const double x = p.x();
    const double y = p.y();
    Eigen::Matrix2d J;
    J << g + 2 * x * x * dg + 2 * p1 * y + 6 * p2 * x, 2 * x * y * dg + 2 * p1 * x + 2 * p2 * y,
        2 * x * y * dg + 2 * p1 * x + 2 * p2 * y, g + 2 * y * y * dg + 6 * p1 * y + 2 * p2 * x;
    const double det = J.determinant();
    if (!std::isfinite(det) || std::abs(det) < 1e-9) return std::nullopt;
    Eigen::Vector2d step = J.inverse() * error;
    // Far from the solution a full step may jump over the fold: at most half the field of view at once.
    if (step.norm() > 0.5) step *= 0.5 / step.norm();
    p -= step;
  }
  if (!((Distort(p) - target).norm() < 1e-9)) return std::nullopt;
  const double r2 = p.squaredNorm();
  const auto [g, dg] = RadialFactor(*this, r2);
  if (!(g + 2 * r2 * dg > 0) || !(g > 0)) return std::nullopt;  // converged on the folded branch
  return p;
}

cv::Mat2f UnprojectionTable(const PinholeCamera& camera) {
  cv::Mat2f table(camera.height, camera.width);
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const auto ray = camera.Unproject(Eigen::Vector2d(u, v));
      table(v, u) =
          ray ? cv::Vec2f(static_cast<float>(ray->x()), static_cast<float>(ray->y())) : cv::Vec2f(kNan, kNan);
    }
  }
  return table;
}

Status FisheyeCamera::Validate() const {
  if (auto ok = CheckSizeAndFocal(width, height, fx, fy, cx, cy); !ok) return ok;
  const std::pair<const char*, double> numbers[] = {{"k1", k1}, {"k2", k2}, {"k3", k3}, {"k4", k4}};
  for (const auto& [name, value] : numbers) {
    if (!std::isfinite(value)) return Fail(ErrorCode::kBadInput, std::string(name) + " is not finite");
  }
  if (!(max_angle_rad > 0 && max_angle_rad <= 3.1416)) {
    return Fail(ErrorCode::kBadInput, "max_angle_deg is outside 0..180");
  }
  return {};
}

std::optional<Eigen::Vector2d> FisheyeCamera::Project(const Eigen::Vector3d& p) const {
  const double rho = p.head<2>().norm();
  const double theta = std::atan2(rho, p.z());  // never atan(rho / z): the lens sees behind 90 degrees
  if (!(theta <= max_angle_rad)) return std::nullopt;
  const double t2 = theta * theta;
  const double r = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
  const Eigen::Vector2d direction = rho > 0 ? Eigen::Vector2d(p.head<2>() / rho) : Eigen::Vector2d(0, 0);
  return Eigen::Vector2d(fx * r * direction.x() + cx, fy * r * direction.y() + cy);
}

std::optional<Eigen::Vector3d> FisheyeCamera::Unproject(const Eigen::Vector2d& pixel) const {
  const Eigen::Vector2d m((pixel.x() - cx) / fx, (pixel.y() - cy) / fy);
  const double r = m.norm();
  double theta = r;
  for (int i = 0; i < 30; ++i) {
    const double t2 = theta * theta;
    const double value = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))) - r;
    const double slope = 1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4)));
    if (std::abs(value) < 1e-13) break;
    if (!(slope > 1e-6)) return std::nullopt;
    theta -= value / slope;
  }
  if (!(theta >= 0 && theta <= max_angle_rad)) return std::nullopt;
  if (r < 1e-12) return Eigen::Vector3d(0, 0, 1);
  return Eigen::Vector3d(std::sin(theta) * m.x() / r, std::sin(theta) * m.y() / r, std::cos(theta));
}

}  // namespace mixstage
