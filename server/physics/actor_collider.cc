// SPDX-License-Identifier: Apache-2.0
#include "server/physics/actor_collider.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace mixstage {
namespace {

constexpr double kLongestGapS = 0.15;
constexpr int kFewestPoints = 3;
constexpr int kMostMissed = 2;
// Of what is measured beyond what was expected: taken over at once, and into the velocity.
constexpr double kFollow = 0.6, kAccelerate = 0.35;
// The reach as cells about the camera: nothing is measured farther away.
constexpr double kCellM = 0.5;
constexpr int kCells = 80;

int CellOf(double offset_m) { return static_cast<int>(std::floor(offset_m / kCellM)) + kCells / 2; }
std::size_t CellIndex(const Eigen::Vector3d& offset) {
  std::size_t index = 0;
  for (int k = 0; k < 3; ++k) {
    const int cell = CellOf(offset[k]);
    if (cell < 0 || cell >= kCells) return std::numeric_limits<std::size_t>::max();
    index = index * kCells + static_cast<std::size_t>(cell);
  }
  return index;
}

}  // namespace

ActorCollider::ActorCollider(const PinholeCamera& color, const ActorColliderConfig& config)
    : config_(config), wanted_(static_cast<std::size_t>(kCells) * kCells * kCells, false) {
  const int height = (color.height + 1) / 2;
  const int width = (color.width + 1) / 2;
  // A dozen points for a ball at 2.5 m.
  step_px_ = std::max(1, static_cast<int>(config.spacing_m / 4 * color.fx / 2 / 2.5));
  for (int y = step_px_ / 2; y < height; y += step_px_, ++rows_) {
    columns_ = 0;
    for (int x = step_px_ / 2; x < width; x += step_px_, ++columns_) {
      const auto ray = color.Unproject({2 * x + 0.5, 2 * y + 0.5});
      const float nan = std::numeric_limits<float>::quiet_NaN();
      rays_.push_back(ray ? Eigen::Vector2f(ray->cast<float>()) : Eigen::Vector2f(nan, nan));
    }
  }
}

std::span<const ActorBall> ActorCollider::Run(ImageView<const float> actor_depth_m,
                                              const RigidTransform& T_scene_color,
                                              std::span<const Eigen::AlignedBox3d> reach, std::int64_t t_us) {
  const double dt_s = static_cast<double>(t_us - last_us_) * 1e-6;
  last_us_ = t_us;
  const bool follows = dt_s > 0 && dt_s <= kLongestGapS;
  if (!follows || reach.empty()) {
    tracks_.clear();
    balls_.clear();
  }
  if (reach.empty()) return {};
  Gather(actor_depth_m, T_scene_color, reach);
  for (Track& track : tracks_) track.expected = track.at + dt_s * track.velocity;
  Assign();
  const Eigen::Vector3d camera = T_scene_color.translation();
  Move(camera, dt_s);
  Seed(camera);
  return balls_;
}

void ActorCollider::Gather(ImageView<const float> actor_depth_m, const RigidTransform& T_scene_color,
                           std::span<const Eigen::AlignedBox3d> reach) {
  std::fill(wanted_.begin(), wanted_.end(), false);
  const Eigen::Vector3d camera = T_scene_color.translation();
  const auto clamped = [](double offset_m) { return std::clamp(CellOf(offset_m), 0, kCells - 1); };
  for (const Eigen::AlignedBox3d& box : reach) {
    const Eigen::Vector3d low = box.min() - camera;
    const Eigen::Vector3d high = box.max() - camera;
    for (int x = clamped(low.x()); x <= clamped(high.x()); ++x) {
      for (int y = clamped(low.y()); y <= clamped(high.y()); ++y) {
        for (int z = clamped(low.z()); z <= clamped(high.z()); ++z)
          wanted_[static_cast<std::size_t>((x * kCells + y) * kCells + z)] = true;
      }
    }
  }
  points_.clear();
  for (int row = 0; row < rows_; ++row) {
    const int v = step_px_ / 2 + row * step_px_;
    if (v >= actor_depth_m.height()) break;
    const float* depth = actor_depth_m.row(v);
    for (int column = 0; column < columns_; ++column) {
      const int u = step_px_ / 2 + column * step_px_;
      if (u >= actor_depth_m.width()) break;
      const float z = depth[u];
      if (!(z > 0)) continue;
      const Eigen::Vector2f& ray = rays_[static_cast<std::size_t>(row * columns_ + column)];
      if (!ray.allFinite()) continue;
      const Eigen::Vector3d p = T_scene_color * Eigen::Vector3f(z * ray.x(), z * ray.y(), z).cast<double>();
      const std::size_t cell = CellIndex(p - camera);
      if (cell < wanted_.size() && wanted_[cell]) points_.push_back(p);
    }
  }
}

// Every point to the ball that expects it nearest, if one does within its spacing.
void ActorCollider::Assign() {
  unclaimed_.clear();
  for (Track& track : tracks_) {
    track.sum.setZero();
    track.moments.setZero();
    track.points = 0;
  }
  // Tracks sorted along x: a point looks only at those within reach of it.
  std::vector<std::pair<double, std::size_t>> along(tracks_.size());
  for (std::size_t i = 0; i < tracks_.size(); ++i) along[i] = {tracks_[i].expected.x(), i};
  std::ranges::sort(along);
  const double reach = 1.2 * config_.spacing_m;
  for (const Eigen::Vector3d& p : points_) {
    auto entry = std::ranges::lower_bound(along, std::pair(p.x() - reach, std::size_t{0}));
    double best = reach * reach;
    Track* nearest = nullptr;
    for (; entry != along.end() && entry->first <= p.x() + reach; ++entry) {
      Track& track = tracks_[entry->second];
      const double distance = (track.expected - p).squaredNorm();
      if (distance < best) best = distance, nearest = &track;
    }
    if (nearest == nullptr) {
      unclaimed_.push_back(p);
      continue;
    }
    const Eigen::Vector3d offset = p - nearest->expected;
    nearest->sum += offset;
    nearest->moments += offset * offset.transpose();
    ++nearest->points;
  }
}

void ActorCollider::Move(const Eigen::Vector3d& camera, double dt_s) {
  const double farthest = config_.fastest_m_s * std::max(dt_s, 0.0);
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    Track& track = tracks_[i];
    const Eigen::Vector3d before = track.at;
    Eigen::Vector3d to_camera = (camera - track.expected).normalized();
    Eigen::Vector3d normal = to_camera;
    if (track.points >= kFewestPoints) {
      const Eigen::Vector3d mean = track.sum / track.points;
      track.at = track.expected + kFollow * mean;
      track.velocity += kAccelerate / dt_s * mean;
      track.missed = 0;
      if (track.points >= 3 * kFewestPoints) {
        const Eigen::Matrix3d spread = track.moments / track.points - mean * mean.transpose();
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread);
        normal = axes.eigenvectors().col(0);
        if (normal.dot(to_camera) < 0) normal = -normal;
        // Where the piece has no clear plane its side to the camera counts.
        if (!(axes.eigenvalues()[0] < 0.2 * axes.eigenvalues()[1])) normal = to_camera;
      }
    } else {
      track.at = track.expected;
      ++track.missed;
    }
    const double speed = track.velocity.norm();
    if (speed > config_.fastest_m_s) track.velocity *= config_.fastest_m_s / speed;
    if ((track.at - before).norm() > farthest)
      track.at = before + farthest * (track.at - before).normalized();
    ActorBall& ball = balls_[i];
    Eigen::Vector3d center = track.at - config_.radius_m * normal;
    // The normal trembles: the ball may not.
    if (track.points >= kFewestPoints) center = 0.5 * (center + ball.center + (track.at - before));
    if ((center - ball.center).norm() > farthest)
      center = ball.center + farthest * (center - ball.center).normalized();
    ball.center = center;
  }
  // Gone, or over an older one.
  std::vector<bool> drop(tracks_.size(), false);
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    drop[i] = tracks_[i].missed > kMostMissed;
    for (std::size_t k = 0; k < i && !drop[i]; ++k)
      drop[i] = !drop[k] && (tracks_[i].at - tracks_[k].at).norm() < 0.4 * config_.spacing_m;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < tracks_.size(); ++i) {
    if (drop[i]) continue;
    tracks_[kept] = tracks_[i];
    balls_[kept] = balls_[i];
    ++kept;
  }
  tracks_.resize(kept);
  balls_.resize(kept);
}

// What no ball expected gets balls of its own; they move as the nearest of the others does.
void ActorCollider::Seed(const Eigen::Vector3d& camera) {
  const std::size_t older = tracks_.size();
  for (const Eigen::Vector3d& p : unclaimed_) {
    if (tracks_.size() >= config_.most) return;
    const bool covered = std::ranges::any_of(tracks_, [&](const Track& track) {
      return (track.at - p).squaredNorm() < config_.spacing_m * config_.spacing_m;
    });
    if (covered) continue;
    Track track;
    track.at = p;
    double nearest = 0.25;
    for (std::size_t i = 0; i < older; ++i) {
      const double distance = (tracks_[i].at - p).norm();
      if (distance < nearest) nearest = distance, track.velocity = tracks_[i].velocity;
    }
    tracks_.push_back(track);
    balls_.push_back({++last_id_, p - config_.radius_m * (camera - p).normalized(), config_.radius_m});
  }
}

}  // namespace mixstage
