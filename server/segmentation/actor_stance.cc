// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_stance.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "proto/base/check.h"
#include "proto/base/median.h"
#include "server/segmentation/half_picture.h"

namespace mixstage {
namespace {

constexpr std::size_t kFewestPoints = 300;
constexpr int kFits = 4;
constexpr double kFarOff = 2;          // standard deviations off the axis: a stretched arm is not the body
constexpr double kLeastSlimness = 2;   // length of the cloud over its width
constexpr double kSoleShare = 0.01;    // of the points lie lower than the soles: noise
constexpr double kLeastUpright = 0.5;  // cosine between the axis and the picture's up
constexpr int kBorder = 2;             // half-size pixels

}  // namespace

RigidTransform PoseOver(const Eigen::Vector3d& up_in_camera, double height_m) {
  const Eigen::Vector3d z = up_in_camera.normalized();
  // Looking straight down what is above in the picture lies in front.
  Eigen::Vector3d x = Eigen::Vector3d::UnitZ() - z.z() * z;
  if (x.norm() < 1e-3) x = -Eigen::Vector3d::UnitY() + z.y() * z;
  x.normalize();
  RigidTransform T = RigidTransform::Identity();
  T.linear().row(0) = x.transpose();
  T.linear().row(1) = z.cross(x).transpose();
  T.linear().row(2) = z.transpose();
  T.translation() = Eigen::Vector3d(0, 0, height_m);
  return T;
}

ActorStance::ActorStance(const PinholeCamera& color) : half_rays_(Half(color.height), Half(color.width)) {
  for (int y = 0; y < half_rays_.rows; ++y) {
    for (int x = 0; x < half_rays_.cols; ++x) {
      const auto ray = color.Unproject({2 * x + 0.5, 2 * y + 0.5});
      half_rays_(y, x) =
          ray ? cv::Vec2f(static_cast<float>(ray->x()), static_cast<float>(ray->y())) : cv::Vec2f::all(NAN);
    }
  }
}

bool ActorStance::Collect(ImageView<const float> actor_depth_m) {
  points_.clear();
  for (int y = 0; y < half_rays_.rows; ++y) {
    for (int x = 0; x < half_rays_.cols; ++x) {
      const double z = actor_depth_m.at(x, y);
      if (!(z > 0) || std::isnan(half_rays_(y, x)[0])) continue;
      if (x < kBorder || y < kBorder || x >= half_rays_.cols - kBorder || y >= half_rays_.rows - kBorder)
        return false;
      if (((x | y) & 1) == 0) points_.emplace_back(z * half_rays_(y, x)[0], z * half_rays_(y, x)[1], z);
    }
  }
  return points_.size() >= kFewestPoints;
}

std::optional<ActorStance::Line> ActorStance::PrincipalAxis() const {
  Line line;
  double width = 1e9;  // standard deviation off the axis
  for (int fit = 0; fit < kFits; ++fit) {
    const auto off = [&](const Eigen::Vector3d& p) {
      const Eigen::Vector3d d = p - line.middle;
      return (d - d.dot(line.direction) * line.direction).norm();
    };
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    std::size_t count = 0;
    std::vector<char> near(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) {
      near[i] = fit == 0 || off(points_[i]) <= kFarOff * width;
      if (near[i] == 0) continue;
      sum += points_[i];
      ++count;
    }
    if (count < kFewestPoints / 2) return std::nullopt;
    line.middle = sum / static_cast<double>(count);
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (near[i] == 0) continue;
      const Eigen::Vector3d d = points_[i] - line.middle;
      covariance += d * d.transpose() / static_cast<double>(count);
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
    const Eigen::Vector3d& spread = solver.eigenvalues();
    if (!(spread[2] > kLeastSlimness * kLeastSlimness * spread[1])) return std::nullopt;
    line.direction = solver.eigenvectors().col(2);
    width = std::sqrt(spread[0] + spread[1]);
  }
  if (line.direction.y() > 0) line.direction = -line.direction;  // y goes down
  if (-line.direction.y() < kLeastUpright) return std::nullopt;
  return line;
}

void ActorStance::See(ImageView<const float> actor_depth_m) {
  MIX_CHECK(actor_depth_m.width() == half_rays_.cols && actor_depth_m.height() == half_rays_.rows);
  if (ups_.size() >= kMostFrames || !Collect(actor_depth_m)) return;
  const auto axis = PrincipalAxis();
  if (!axis) return;
  ups_.push_back(axis->direction);
  Eigen::Vector3d up;
  for (int k = 0; k < 3; ++k) {
    std::vector<double> values;
    for (const Eigen::Vector3d& seen : ups_) values.push_back(seen[k]);
    up[k] = Median(std::move(values));
  }
  up.normalize();
  std::vector<double> along;
  for (const Eigen::Vector3d& p : points_) along.push_back(up.dot(p));
  const auto sole =
      along.begin() + static_cast<std::ptrdiff_t>(kSoleShare * static_cast<double>(along.size()));
  std::nth_element(along.begin(), sole, along.end());
  heights_m_.push_back(-*sole);
  T_world_color_ = PoseOver(up, Median(std::vector(heights_m_)));
}

}  // namespace mixstage
