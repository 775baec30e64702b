// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/room_depth_probe.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace mixstage {
namespace {

constexpr int kReach = 2;         // samples to each side that a surface is fitted to
constexpr double kNearby = 0.05;  // of the depth: farther samples are another surface
constexpr double kLeastSigma_m = 0.004;
constexpr int kFits = 3;

// Under a footprint: what lies this much above the base still carries it (an object that sank in a little).
constexpr double kSunken_m = 0.05;
constexpr double kLeastFootprint_m = 0.05;
constexpr double kLevelCosine = 0.7;  // of the angle between a surface that carries and the horizontal
constexpr double kLayer_m = 0.04;     // a horizontal surface with its noise is not thicker
constexpr double kLayerShare = 0.15;  // of the footprint's level samples make a surface
constexpr std::size_t kLayerCount = 6;

struct Measured {
  Eigen::Vector2d direction;
  double z = 0, sigma = 0;
};

// A plane is linear in 1/z over (x/z, y/z). z at `at` by samples that agree with each other, near z_near.
double FitDepth(const std::vector<Measured>& samples, const Eigen::Vector2d& at, double z_near) {
  Eigen::Vector3d plane(1 / z_near, 0, 0);
  double gate = kNearby * z_near;  // m
  for (int fit = 0; fit < kFits; ++fit) {
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    int count = 0;
    for (const Measured& sample : samples) {
      const Eigen::Vector3d row(1, sample.direction.x() - at.x(), sample.direction.y() - at.y());
      if (!(std::abs(sample.z - 1 / row.dot(plane)) <= std::max(gate, 3 * sample.sigma))) continue;
      const double weight = sample.z * sample.z / sample.sigma;  // of 1/z
      A += weight * weight * row * row.transpose();
      b += weight * weight * row / sample.z;
      ++count;
    }
    if (count < 6) break;
    const Eigen::Vector3d next = A.ldlt().solve(b);
    if (!next.allFinite()) break;
    plane = next;
    gate = 0.01;
  }
  const double z = 1 / plane[0];
  return std::abs(z - z_near) <= kNearby * z_near ? z : z_near;
}

}  // namespace

RoomDepthProbe::RoomDepthProbe(const PinholeCamera& color)
    : color_(color), directions_(Quarter(color.height), Quarter(color.width)) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (int y = 0; y < directions_.rows; ++y) {
    for (int x = 0; x < directions_.cols; ++x) {
      // Where QuarterDepth takes its samples.
      const auto direction =
          color.Unproject({std::min(4 * x + 1, color.width - 1), std::min(4 * y + 1, color.height - 1)});
      directions_(y, x) =
          direction ? cv::Vec2f(static_cast<float>(direction->x()), static_cast<float>(direction->y()))
                    : cv::Vec2f(kNan, kNan);
    }
  }
}

void RoomDepthProbe::Look(std::shared_ptr<const BackgroundModel> room, const RigidTransform& T_scene_color,
                          const Eigen::Vector3d& up) {
  room_ = std::move(room);
  if (room_ && (!room_->has_depth() || room_->room_depth_m.size() != directions_.size())) room_.reset();
  T_scene_color_ = T_scene_color;
  up_ = up;
}

std::optional<Eigen::Vector2d> RoomDepthProbe::Direction(double u, double v) const {
  if (!(u >= -0.5 && v >= -0.5 && u <= color_.width - 0.5 && v <= color_.height - 0.5)) return std::nullopt;
  return color_.Unproject({u, v});
}

std::optional<RoomProbe::Ray> RoomDepthProbe::RayThrough(double u, double v) const {
  const auto direction = Direction(u, v);
  if (!direction) return std::nullopt;
  return Ray{T_scene_color_.translation(), T_scene_color_.linear() * direction->homogeneous()};
}

std::optional<Eigen::Vector3d> RoomDepthProbe::SurfaceUnder(double u, double v) const {
  const auto direction = Direction(u, v);
  if (!room_ || !direction) return std::nullopt;
  const double at_x = (u - 1) / 4;
  const double at_y = (v - 1) / 4;
  const cv::Rect window =
      cv::Rect(static_cast<int>(std::lround(at_x)) - kReach, static_cast<int>(std::lround(at_y)) - kReach,
               2 * kReach + 1, 2 * kReach + 1) &
      cv::Rect({0, 0}, directions_.size());
  std::vector<Measured> samples;
  double nearest = 1.5;  // samples away: farther, and the pixel's own depth is not known
  double z_near = 0;
  for (int y = window.y; y < window.br().y; ++y) {
    for (int x = window.x; x < window.br().x; ++x) {
      const double z = room_->room_depth_m(y, x);
      const cv::Vec2f& ray = directions_(y, x);
      if (!(z > 0) || std::isnan(ray[0])) continue;
      samples.push_back({{ray[0], ray[1]}, z, std::max<double>(kLeastSigma_m, room_->sigma_m(y, x))});
      const double away = std::hypot(x - at_x, y - at_y);
      if (away >= nearest) continue;
      nearest = away;
      z_near = z;
    }
  }
  if (z_near == 0) return std::nullopt;
  return T_scene_color_ * (FitDepth(samples, *direction, z_near) * direction->homogeneous());
}

std::optional<Eigen::Vector3d> RoomDepthProbe::Sample(int x, int y) const {
  if (x < 0 || y < 0 || x >= directions_.cols || y >= directions_.rows) return std::nullopt;
  const double z = room_->room_depth_m(y, x);
  const cv::Vec2f& ray = directions_(y, x);
  if (!(z > 0) || std::isnan(ray[0])) return std::nullopt;
  return T_scene_color_ * Eigen::Vector3d(ray[0] * z, ray[1] * z, z);
}

// By the samples to each side: the front of a cupboard carries nothing, however its noise sways.
bool RoomDepthProbe::IsLevel(int x, int y) const {
  const auto left = Sample(x - kReach, y);
  const auto right = Sample(x + kReach, y);
  const auto above = Sample(x, y - kReach);
  const auto below = Sample(x, y + kReach);
  if (!left || !right || !above || !below) return false;
  return std::abs(up_.dot((*right - *left).cross(*below - *above).normalized())) > kLevelCosine;
}

std::optional<double> RoomDepthProbe::HighestSurfaceBelow(const Eigen::Vector3d& base,
                                                          double radius_m) const {
  if (!room_) return std::nullopt;
  const double radius = std::max(radius_m, kLeastFootprint_m);
  std::vector<double> heights;  // above base
  for (int y = 0; y < directions_.rows; ++y) {
    for (int x = 0; x < directions_.cols; ++x) {
      const auto point = Sample(x, y);
      if (!point) continue;
      const Eigen::Vector3d offset = *point - base;
      const double height = up_.dot(offset);
      if (height > kSunken_m || (offset - height * up_).squaredNorm() > radius * radius) continue;
      if (IsLevel(x, y)) heights.push_back(height);
    }
  }
  const std::size_t layer =
      std::max(kLayerCount, static_cast<std::size_t>(kLayerShare * static_cast<double>(heights.size())));
  if (heights.size() < layer) return std::nullopt;
  std::sort(heights.begin(), heights.end(), std::greater<>());
  // From above, the first layer that holds enough of them; its surface is the middle of what it holds.
  for (std::size_t i = 0; i + layer <= heights.size(); ++i) {
    if (heights[i] - heights[i + layer - 1] > kLayer_m) continue;
    const auto end = std::find_if(heights.begin() + static_cast<std::ptrdiff_t>(i), heights.end(),
                                  [&](double h) { return h < heights[i] - kLayer_m; });
    const auto count = static_cast<std::size_t>(end - heights.begin()) - i;
    return up_.dot(base) + heights[i + count / 2];
  }
  return std::nullopt;
}

}  // namespace mixstage
