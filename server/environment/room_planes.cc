// SPDX-License-Identifier: Apache-2.0
#include "server/environment/room_planes.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>

namespace mixstage {
namespace {

constexpr float kOnPlane = 3.0f;         // sigmas of a node that still lies on a plane
constexpr float kCosSameNormal = 0.95f;  // 18 degrees: what noise does to the normal of one node's fit
constexpr double kFlat = 1.5;            // rms in sigmas of what is still flat
constexpr double kSameMean = 3.0;        // sigmas of a mean residual that is still zero

class Sums {
 public:
  void Add(const SurfaceNodes& n, std::size_t i) {
    const double weight = 1.0 / (static_cast<double>(n.sigma[i]) * n.sigma[i]);
    const Eigen::Vector3d ray = n.ray[i].cast<double>();
    A_ += weight * ray * ray.transpose();
    b_ += weight * n.inverse_range[i] * ray;
    ++count_;
  }
  void Add(const Sums& other) {
    A_ += other.A_;
    b_ += other.b_;
    count_ += other.count_;
  }
  [[nodiscard]] Eigen::Vector3d Plane() const { return A_.ldlt().solve(b_); }
  [[nodiscard]] int count() const { return count_; }

 private:
  Eigen::Matrix3d A_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b_ = Eigen::Vector3d::Zero();
  int count_ = 0;
};

float Misfit(const SurfaceNodes& n, std::size_t i, const Eigen::Vector3f& m) {
  return (n.inverse_range[i] - m.dot(n.ray[i])) / n.sigma[i];
}

class Grower {
 public:
  explicit Grower(SurfaceNodes& nodes) : n_(nodes), member_(nodes.ray.size(), -1) {
    normal_.resize(n_.ray.size(), Eigen::Vector3f::Zero());
    for (std::size_t i = 0; i < normal_.size(); ++i)
      if (!n_.plane[i].isZero()) normal_[i] = n_.plane[i].normalized();
  }

  std::vector<GrownPlane> Run(const PlaneConfig& config) {
    std::vector<std::pair<float, int>> seeds = Seeds();
    for (const auto& [flatness, seed] : seeds) {
      if (member_[static_cast<std::size_t>(seed)] >= 0) continue;
      Grow(seed, config);
    }
    Merge();
    return Assign(config);
  }

 private:
  // Nodes whose surroundings have one normal, the flattest first.
  [[nodiscard]] std::vector<std::pair<float, int>> Seeds() const {
    std::vector<std::pair<float, int>> seeds;
    for (int y = 4; y + 4 < n_.height; y += 2) {
      for (int x = 4; x + 4 < n_.width; x += 2) {
        const int i = n_.At(x, y);
        const auto at = static_cast<std::size_t>(i);
        if (n_.plane[at].isZero()) continue;
        float flat = 0;
        int on = 0;
        for (int dy = -4; dy <= 4; dy += 2) {
          for (int dx = -4; dx <= 4; dx += 2) {
            const auto j = static_cast<std::size_t>(n_.At(x + dx, y + dy));
            if (n_.plane[j].isZero() || std::abs(Misfit(n_, j, n_.plane[at])) > kOnPlane) continue;
            flat += normal_[at].dot(normal_[j]);
            ++on;
          }
        }
        if (on >= 20) seeds.emplace_back(-flat, i);
      }
    }
    std::sort(seeds.begin(), seeds.end());
    return seeds;
  }

  void Grow(int seed, const PlaneConfig& config) {
    const int label = static_cast<int>(sums_.size());
    std::vector<int> front = {seed}, members;
    Sums sums;
    Eigen::Vector3f m = n_.plane[static_cast<std::size_t>(seed)];
    Eigen::Vector3f normal = m.normalized();
    member_[static_cast<std::size_t>(seed)] = label;
    int refit_at = 30;
    for (std::size_t next = 0; next < front.size(); ++next) {
      const int i = front[next];
      members.push_back(i);
      sums.Add(n_, static_cast<std::size_t>(i));
      if (sums.count() >= refit_at) {
        m = sums.Plane().cast<float>();
        normal = m.normalized();
        refit_at = sums.count() * 3 / 2;
      }
      const int x = i % n_.width, y = i / n_.width;
      for (const auto& [dx, dy] : {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}}) {
        const int at = n_.At(x + dx, y + dy);
        if (at < 0) continue;
        const auto j = static_cast<std::size_t>(at);
        if (member_[j] >= 0 || n_.inverse_range[j] == 0 || n_.plane[j].isZero()) continue;
        if (std::abs(Misfit(n_, j, m)) > kOnPlane || normal.dot(normal_[j]) < kCosSameNormal) continue;
        // The node's fit, less noisy than its own depth, must lie there as well.
        const float fit_misfit = (n_.plane[j] - m).dot(n_.ray[j]) / n_.sigma[j];
        if (std::abs(fit_misfit) > 1.0f) continue;
        member_[j] = label;
        front.push_back(at);
      }
    }
    if (static_cast<int>(members.size()) < config.least_nodes / 2) {
      for (const int i : members) member_[static_cast<std::size_t>(i)] = -1;
      return;
    }
    sums_.push_back(sums);
    members_.push_back(std::move(members));
  }

  // How far a plane's members lie off m in the mean, in sigmas of that mean (half a millimetre at 2 m is
  // always the same plane).
  [[nodiscard]] bool MeanFits(const std::vector<int>& members, const Eigen::Vector3f& m) const {
    double sum = 0, weight = 0;
    for (const int i : members) {
      const auto at = static_cast<std::size_t>(i);
      const double w = 1.0 / (static_cast<double>(n_.sigma[at]) * n_.sigma[at]);
      sum += w * (n_.inverse_range[at] - m.dot(n_.ray[at]));
      weight += w;
    }
    return std::abs(sum / weight) < kSameMean / std::sqrt(weight) + 5e-4;
  }

  // What lies flat on a plane (a picture's frame, a carpet) is within its noise and would pull it: nodes
  // count by how well their fits, four times less noisy than their depths, lie on it.
  [[nodiscard]] Eigen::Vector3d RobustPlane(const std::vector<int>& members, Eigen::Vector3d m) const {
    constexpr double kFitSigma = 0.25;
    for (int pass = 0; pass < 5; ++pass) {
      Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
      Eigen::Vector3d b = Eigen::Vector3d::Zero();
      for (const int i : members) {
        const auto at = static_cast<std::size_t>(i);
        const Eigen::Vector3d ray = n_.ray[at].cast<double>();
        const double off = (n_.plane[at].cast<double>() - m).dot(ray) / (kFitSigma * n_.sigma[at]);
        const double weight = 1.0 / (1 + off * off) / (static_cast<double>(n_.sigma[at]) * n_.sigma[at]);
        A += weight * ray * ray.transpose();
        b += weight * n_.inverse_range[at] * ray;
      }
      m = A.ldlt().solve(b);
    }
    return m;
  }

  // Parts of one wall to both sides of what stands before it.
  void Merge() {
    std::vector<std::size_t> order(sums_.size());
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(),
              [&](std::size_t a, std::size_t b) { return sums_[a].count() > sums_[b].count(); });
    into_.assign(sums_.size(), -1);
    for (std::size_t k = 0; k < order.size(); ++k) {
      const std::size_t b = order[k];
      for (std::size_t l = 0; l < k; ++l) {
        const std::size_t a = order[l];
        if (into_[a] >= 0) continue;
        const Eigen::Vector3d pa = sums_[a].Plane(), pb = sums_[b].Plane();
        if (pa.normalized().dot(pb.normalized()) < kCosSameNormal) continue;
        Sums both = sums_[a];
        both.Add(sums_[b]);
        const Eigen::Vector3f m = both.Plane().cast<float>();
        if (!MeanFits(members_[a], m) || !MeanFits(members_[b], m)) continue;
        sums_[a] = both;
        members_[a].insert(members_[a].end(), members_[b].begin(), members_[b].end());
        into_[b] = static_cast<int>(a);
        break;
      }
    }
  }

  // A node lies on a plane of its neighbourhood when its own depth does and, in the mean, so do its
  // neighbours that belong to no other plane: two centimetres of a picture frame before a wall show in the
  // mean alone.
  std::vector<GrownPlane> Assign(const PlaneConfig& config) {
    std::vector<int> core(n_.ray.size(), -1);
    std::vector<GrownPlane> planes;
    for (std::size_t a = 0; a < sums_.size(); ++a) {
      if (into_[a] >= 0) continue;
      GrownPlane plane;
      plane.m = RobustPlane(members_[a], sums_[a].Plane());
      const double node_rad2 = NodeSolidAngle();
      double sum2 = 0;
      for (const int i : members_[a]) {
        const auto at = static_cast<std::size_t>(i);
        const Eigen::Vector3d ray = n_.ray[at].cast<double>();
        const double inverse_range = plane.m.dot(ray);
        const double cosine = inverse_range / plane.m.norm() / ray.norm();
        if (inverse_range <= 0 || cosine <= 0) continue;
        plane.area_m2 += node_rad2 * std::hypot(ray.x(), ray.y()) / (inverse_range * inverse_range * cosine);
        const double e = Misfit(n_, at, plane.m.cast<float>());
        sum2 += e * e;
      }
      plane.nodes = static_cast<int>(members_[a].size());
      plane.rms_sigma = std::sqrt(sum2 / plane.nodes);
      if (plane.area_m2 < config.least_area_m2 || plane.nodes < config.least_nodes) continue;
      if (plane.rms_sigma > kFlat) continue;  // bent
      for (const int i : members_[a]) core[static_cast<std::size_t>(i)] = static_cast<int>(planes.size());
      planes.push_back(plane);
    }
    std::vector<int> order(planes.size()), rank(planes.size());
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](int a, int b) {
      return planes[static_cast<std::size_t>(a)].area_m2 > planes[static_cast<std::size_t>(b)].area_m2;
    });
    std::vector<GrownPlane> sorted;
    for (const int k : order) {
      rank[static_cast<std::size_t>(k)] = static_cast<int>(sorted.size());
      sorted.push_back(planes[static_cast<std::size_t>(k)]);
    }
    for (int& c : core)
      if (c >= 0) c = rank[static_cast<std::size_t>(c)];
    cv::parallel_for_({0, n_.height}, [&](const cv::Range& rows) {
      for (int y = rows.start; y < rows.end; ++y)
        for (int x = 0; x < n_.width; ++x) AssignNode(x, y, core, sorted);
    });
    for (std::size_t i = 0; i < core.size(); ++i)
      if (n_.room_plane[i] >= 0)
        n_.plane[i] = sorted[static_cast<std::size_t>(n_.room_plane[i])].m.cast<float>();
    return sorted;
  }

  void AssignNode(int x, int y, const std::vector<int>& core, const std::vector<GrownPlane>& planes) {
    const auto i = static_cast<std::size_t>(n_.At(x, y));
    n_.room_plane[i] = -1;
    if (n_.inverse_range[i] == 0) return;
    constexpr int kReach = 3;
    std::array<int, 8> near{};
    std::size_t count = 0;
    for (int dy = -kReach; dy <= kReach; ++dy) {
      for (int dx = -kReach; dx <= kReach; ++dx) {
        const int at = n_.At(x + dx, y + dy);
        const int plane = at < 0 ? -1 : core[static_cast<std::size_t>(at)];
        if (plane < 0 || std::find(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count), plane) !=
                             near.begin() + static_cast<std::ptrdiff_t>(count))
          continue;
        if (count < near.size()) near[count++] = plane;
      }
    }
    float best = std::numeric_limits<float>::max();
    for (std::size_t k = 0; k < count; ++k) {
      const Eigen::Vector3f m = planes[static_cast<std::size_t>(near[k])].m.cast<float>();
      const float own = std::abs(Misfit(n_, i, m));
      if (own > kOnPlane) continue;
      float sum = 0, norm2 = 0, on = 0;
      for (int dy = -2; dy <= 2; ++dy) {
        for (int dx = -2; dx <= 2; ++dx) {
          const int at = n_.At(x + dx, y + dy);
          if (at < 0) continue;
          const auto j = static_cast<std::size_t>(at);
          if (n_.inverse_range[j] == 0 || (core[j] >= 0 && core[j] != near[k])) continue;
          const float e = Misfit(n_, j, m);
          if (std::abs(e) > 6) continue;  // beyond a step
          const float w = std::exp(-0.25f * static_cast<float>(dx * dx + dy * dy));
          sum += w * e;
          norm2 += w * w;
          on += core[j] == near[k] ? w : 0.f;
        }
      }
      const float mean = std::abs(sum) / std::sqrt(norm2);
      if (mean > 2.5f && core[i] != near[k]) continue;
      const float score = mean + own - 0.2f * on;
      if (score < best) {
        best = score;
        n_.room_plane[i] = near[k];
      }
    }
  }

  [[nodiscard]] double NodeSolidAngle() const {
    // Equal steps of a sphere's rows and columns; the row's cosine comes with the ray. A cylinder's rows
    // differ a little: the area is a threshold, no measurement.
    const auto a = static_cast<std::size_t>(n_.At(n_.width / 2, n_.height / 2));
    const auto b = static_cast<std::size_t>(n_.At(n_.width / 2 + 1, n_.height / 2));
    const double step = (n_.ray[a].normalized() - n_.ray[b].normalized()).norm() /
                        std::max(1e-6f, std::hypot(n_.ray[a].x(), n_.ray[a].y()));
    return step * step;
  }

  SurfaceNodes& n_;
  std::vector<int> member_;
  std::vector<Eigen::Vector3f> normal_;
  std::vector<Sums> sums_;
  std::vector<std::vector<int>> members_;
  std::vector<int> into_;
};

}  // namespace

std::vector<GrownPlane> GrowPlanes(SurfaceNodes& nodes, const PlaneConfig& config) {
  if (nodes.width < 12 || nodes.height < 12) return {};
  return Grower(nodes).Run(config);
}

int FindFloor(const std::vector<GrownPlane>& planes) {
  constexpr double kLevel = 0.966;       // 15 degrees
  constexpr double kLargeEnough = 0.25;  // of the largest level plane below the cameras
  int floor = -1;
  double largest = 0;
  for (const GrownPlane& p : planes)
    if (-p.m.normalized().z() > kLevel) largest = std::max(largest, p.area_m2);
  for (std::size_t k = 0; k < planes.size(); ++k) {
    const GrownPlane& p = planes[k];
    if (-p.m.normalized().z() < kLevel || p.area_m2 < kLargeEnough * largest) continue;
    // 1 / |m| is how far below the cameras it lies.
    if (floor < 0 || p.m.norm() < planes[static_cast<std::size_t>(floor)].m.norm())
      floor = static_cast<int>(k);
  }
  return floor;
}

std::vector<RoomPlane> DescribePlanes(const std::vector<GrownPlane>& planes, const SurfaceNodes& nodes,
                                      const Eigen::Vector3d& center) {
  const int floor = FindFloor(planes);
  std::vector<std::vector<Eigen::Vector3d>> points(planes.size());
  for (std::size_t i = 0; i < nodes.ray.size(); ++i) {
    if (nodes.room_plane[i] < 0 || nodes.inverse_range[i] == 0) continue;
    const auto k = static_cast<std::size_t>(nodes.room_plane[i]);
    const Eigen::Vector3d ray = nodes.ray[i].cast<double>();
    const double inverse_range = planes[k].m.dot(ray);
    if (inverse_range > 0) points[k].push_back(center + ray / inverse_range);
  }
  std::array<int, 6> count{};
  std::vector<RoomPlane> out;
  for (std::size_t k = 0; k < planes.size() && out.size() < 256; ++k) {
    RoomPlane plane;
    plane.normal = -planes[k].m.normalized();
    plane.d = 1 / planes[k].m.norm() - plane.normal.dot(center);
    const double up = plane.normal.z(), height = center.z() - 1 / planes[k].m.norm();
    if (static_cast<int>(k) == floor) {
      plane.kind = PlaneKind::kFloor;
    } else if (up < -0.966 && planes[k].area_m2 > 1) {
      plane.kind = PlaneKind::kCeiling;
    } else if (std::abs(up) < 0.17 && planes[k].area_m2 > 1) {
      plane.kind = PlaneKind::kWall;
    } else if (up > 0.966 && height > 0.3 && height < 1.3) {
      plane.kind = PlaneKind::kTable;
    } else {
      plane.kind = PlaneKind::kOther;
    }
    const int number = ++count[static_cast<std::size_t>(plane.kind)];
    plane.name = PlaneKindName(plane.kind);
    if (number > 1) plane.name.append("_").append(std::to_string(number));
    const Eigen::Vector3d u = plane.normal.unitOrthogonal(), v = plane.normal.cross(u);
    std::vector<cv::Point2f> flat, hull;
    for (const Eigen::Vector3d& p : points[k])
      flat.emplace_back(static_cast<float>(u.dot(p - center)), static_cast<float>(v.dot(p - center)));
    if (flat.size() >= 3) {
      cv::convexHull(flat, hull);
      cv::approxPolyDP(hull, hull, 0.01, true);
      if (hull.size() >= 3 && cv::contourArea(hull, true) < 0) std::reverse(hull.begin(), hull.end());
      const Eigen::Vector3d foot = center - (plane.normal.dot(center) + plane.d) * plane.normal;
      for (const cv::Point2f& p : hull) plane.polygon.push_back(foot + p.x * u + p.y * v);
      if (plane.polygon.size() > 1024) plane.polygon.clear();
    }
    out.push_back(std::move(plane));
  }
  return out;
}

}  // namespace mixstage
