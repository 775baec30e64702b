// SPDX-License-Identifier: Apache-2.0
#include "server/depth/floor_pose.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace mixstage {
namespace {

constexpr int kAcross = 80;  // samples
constexpr int kTries = 400;
// Each fit believes less far from the plane of the one before: a wall's foot is within the noise of a first
// guess.
constexpr std::array kFits = {1.0, 0.7, 0.5, 0.35, 0.35};
constexpr double kLeastCosine = 0.5;
constexpr double kLeastHeight_m = 0.3;
constexpr double kLeastShare = 0.05;
constexpr double kBelowCounts = 2;  // a table has a floor below it
// Noise of structured light and time of flight grows about with the square of the distance.
double Tolerance(double z) { return 0.015 + 0.005 * z * z; }

}  // namespace

std::optional<FloorSeen> FindFloorBelow(ImageView<const float> depth_m, const PinholeCamera& camera) {
  std::vector<Eigen::Vector3d> points;
  const int step = std::max(1, depth_m.width() / kAcross);
  for (int y = step / 2; y < depth_m.height(); y += step) {
    for (int x = step / 2; x < depth_m.width(); x += step) {
      const double z = depth_m.at(x, y);
      if (!(z > 0)) continue;
      if (const auto ray = camera.Unproject(Eigen::Vector2d(x, y))) points.push_back(z * ray->homogeneous());
    }
  }
  if (points.size() < 100) return std::nullopt;
  FloorSeen best;
  double best_score = 0;
  const auto score = [&](const FloorSeen& floor) {
    double inside = 0, below = 0;
    for (const Eigen::Vector3d& p : points) {
      const double above = floor.up.dot(p) + floor.height_m, tolerance = Tolerance(p.z());
      if (std::abs(above) <= tolerance) ++inside;
      if (above < -2 * tolerance) ++below;
    }
    return inside - kBelowCounts * below;
  };
  const auto good = [](const FloorSeen& floor) {
    return -floor.up.y() >= kLeastCosine && floor.height_m >= kLeastHeight_m;
  };
  std::mt19937 random(1);
  for (int i = 0; i < kTries; ++i) {
    // Not std::uniform_int_distribution: its numbers are the library's.
    const auto any = [&]() -> const Eigen::Vector3d& { return points[random() % points.size()]; };
    const Eigen::Vector3d a = any(), b = any(), c = any();
    Eigen::Vector3d normal = (b - a).cross(c - a);
    if (!(normal.norm() > 1e-4)) continue;
    normal.normalize();
    if (normal.y() > 0) normal = -normal;
    const FloorSeen floor{normal, -normal.dot(a)};
    if (!good(floor)) continue;
    const double value = score(floor);
    if (value > best_score) {
      best_score = value;
      best = floor;
    }
  }
  if (best_score <= 0) return std::nullopt;
  std::size_t count = 0;
  for (const double narrowed : kFits) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    std::vector<Eigen::Vector3d> on;
    for (const Eigen::Vector3d& p : points) {
      if (std::abs(best.up.dot(p) + best.height_m) > narrowed * Tolerance(p.z())) continue;
      on.push_back(p);
      middle += p;
    }
    count = on.size();
    if (count < 20) return std::nullopt;
    middle /= static_cast<double>(count);
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const Eigen::Vector3d& p : on) {
      const double weight = 1 / (Tolerance(p.z()) * Tolerance(p.z()));
      covariance += weight * (p - middle) * (p - middle).transpose();
    }
    Eigen::Vector3d normal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvectors().col(0);
    if (normal.y() > 0) normal = -normal;
    best = {normal, -normal.dot(middle)};
    if (!good(best)) return std::nullopt;
  }
  if (static_cast<double>(count) < kLeastShare * static_cast<double>(points.size())) return std::nullopt;
  return best;
}

}  // namespace mixstage
