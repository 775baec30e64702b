// SPDX-License-Identifier: Apache-2.0
#include "server/environment/surface_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr int kRadius = 4;             // nodes: what one node learns from
constexpr float kSpatialSigma = 2.2f;  // nodes
constexpr float kCut2 = 9;             // squared residual in sigmas from which a node is of another surface
constexpr float kOwn = 3.5f;           // sigmas a plane may miss the node's own depth
constexpr int kPasses = 4;

// What a node sees around it.
struct Neighbor {
  int index = 0;
  float weight = 0;
};

class Fitter {
 public:
  explicit Fitter(SurfaceNodes& nodes) : n_(nodes) {
    for (int dy = -kRadius; dy <= kRadius; ++dy) {
      for (int dx = -kRadius; dx <= kRadius; ++dx) {
        const auto d2 = static_cast<float>(dx * dx + dy * dy);
        spatial_[static_cast<std::size_t>((dy + kRadius) * (2 * kRadius + 1) + dx + kRadius)] =
            std::exp(-d2 / (2 * kSpatialSigma * kSpatialSigma));
      }
    }
  }

  void Run() {
    const std::size_t count = n_.ray.size();
    row_.resize(count, Eigen::Vector4f::Zero());
    for (std::size_t i = 0; i < count; ++i) {
      if (n_.inverse_range[i] > 0) row_[i] << n_.ray[i] / n_.sigma[i], n_.inverse_range[i] / n_.sigma[i];
    }
    supported_.assign(count, 0);
    plane_.assign(count, Eigen::Vector3f::Zero());
    Rows([&](int x, int y) { Start(x, y); });
    for (std::size_t i = 0; i < count; ++i)
      if (n_.room_plane[i] < 0) n_.plane[i] = plane_[i];
    plane_ = n_.plane;
    for (int pass = 0; pass < kPasses; ++pass) {
      Rows([&](int x, int y) { Improve(x, y, pass); });
      n_.plane.swap(plane_);
    }
  }

 private:
  template <typename F>
  void Rows(F&& f) {
    cv::parallel_for_({0, n_.height}, [&](const cv::Range& rows) {
      for (int y = rows.start; y < rows.end; ++y)
        for (int x = 0; x < n_.width; ++x) f(x, y);
    });
  }

  std::size_t Around(int x, int y, int radius, std::array<Neighbor, 81>& around) const {
    std::size_t count = 0;
    for (int dy = -radius; dy <= radius; ++dy) {
      for (int dx = -radius; dx <= radius; ++dx) {
        const int at = n_.At(x + dx, y + dy);
        if (at < 0 || n_.inverse_range[static_cast<std::size_t>(at)] == 0) continue;
        if (n_.room_plane[static_cast<std::size_t>(at)] >= 0) continue;
        const float weight =
            spatial_[static_cast<std::size_t>((dy + kRadius) * (2 * kRadius + 1) + dx + kRadius)];
        around[count++] = {at, weight};
      }
    }
    return count;
  }

  float Residual2(const Eigen::Vector3f& m, int at) const {
    const Eigen::Vector4f& row = row_[static_cast<std::size_t>(at)];
    const float e = m.dot(row.head<3>()) - row[3];
    return e * e;
  }

  float Cost(const Eigen::Vector3f& m, std::span<const Neighbor> around) const {
    float cost = 0;
    for (const Neighbor& j : around) cost += j.weight * std::min(Residual2(m, j.index), kCut2);
    return cost;
  }

  // Least squares over the nodes that lie on m (all, where m is zero), held softly at the node's own frontal
  // plane: a strip of nodes does not determine a slant.
  Eigen::Vector3f Fit(const Eigen::Vector3f& m, std::span<const Neighbor> around, std::size_t own) const {
    Eigen::Matrix3f A = Eigen::Matrix3f::Zero();
    Eigen::Vector3f b = Eigen::Vector3f::Zero();
    const bool all = m.isZero();
    // Coordinates about the node's own ray: (ray - own ray) is small, single precision stays exact enough.
    for (const Neighbor& j : around) {
      if (!all && Residual2(m, j.index) > kCut2) continue;
      const auto k = static_cast<std::size_t>(j.index);
      const Eigen::Vector4f& row = row_[k];
      A += j.weight * row.head<3>() * row.head<3>().transpose();
      b += j.weight * row[3] * row.head<3>();
    }
    const Eigen::Vector3f& ray = n_.ray[own];
    const float level = A.trace() > 0 ? ray.dot(b) / std::max(ray.dot(A * ray), 1e-12f) : 0;
    const Eigen::Vector3f frontal = level * ray;
    // A slant of tan = 3 is one sigma.
    const float hold = 1 / std::max(9 * level * level, 1e-6f);
    A.diagonal().array() += hold;
    b += hold * frontal;
    return A.ldlt().solve(b);
  }

  void Start(int x, int y) {
    const auto i = static_cast<std::size_t>(y * n_.width + x);
    if (n_.inverse_range[i] == 0 || n_.room_plane[i] >= 0) return;
    std::array<Neighbor, 81> buffer;
    const std::size_t count = Around(x, y, 2, buffer);
    const std::span<const Neighbor> around(buffer.data(), count);
    int agree = 0;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const int at = n_.At(x + dx, y + dy);
        if (at < 0 || at == static_cast<int>(i)) continue;
        const auto j = static_cast<std::size_t>(at);
        if (n_.inverse_range[j] == 0) continue;
        agree +=
            std::abs(n_.inverse_range[j] - n_.inverse_range[i]) < 3 * std::hypot(n_.sigma[i], n_.sigma[j]);
      }
    }
    supported_[i] = agree >= 2;
    // Frontal first, then twice with what lies on it.
    Eigen::Vector3f m = Fit(Eigen::Vector3f::Zero(), around, i);
    for (int k = 0; k < 2; ++k) m = Fit(m, around, i);
    plane_[i] = m;
  }

  void Improve(int x, int y, int pass) {
    const auto i = static_cast<std::size_t>(y * n_.width + x);
    if (n_.inverse_range[i] == 0 || n_.room_plane[i] >= 0) return;
    std::array<Neighbor, 81> buffer;
    const std::size_t count = Around(x, y, kRadius, buffer);
    const std::span<const Neighbor> around(buffer.data(), count);
    Eigen::Vector3f best = n_.plane[i];
    auto allowed = [&](const Eigen::Vector3f& m) {
      return m.dot(n_.ray[i]) > 0 && (!supported_[i] || Residual2(m, static_cast<int>(i)) < kOwn * kOwn);
    };
    float best_cost = allowed(best) ? Cost(best, around) : std::numeric_limits<float>::max();
    const int reach = pass == 0 ? 1 : pass == 1 ? 3 : 2;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        if (dx == 0 && dy == 0) continue;
        const int at = n_.At(x + reach * dx, y + reach * dy);
        if (at < 0) continue;
        if (n_.room_plane[static_cast<std::size_t>(at)] >= 0) continue;
        const Eigen::Vector3f& m = n_.plane[static_cast<std::size_t>(at)];
        if (m.isZero() || !allowed(m)) continue;
        const float cost = Cost(m, around);
        if (cost < best_cost) {
          best_cost = cost;
          best = m;
        }
      }
    }
    const Eigen::Vector3f refit = Fit(best, around, i);
    if (allowed(refit) && Cost(refit, around) < best_cost) best = refit;
    plane_[i] = best;
  }

  SurfaceNodes& n_;
  std::vector<Eigen::Vector4f> row_;  // m . ray = inverse range, over sigma
  std::array<float, 81> spatial_{};
  std::vector<std::uint8_t> supported_;
  std::vector<Eigen::Vector3f> plane_;
};

}  // namespace

int NodeStep(const PanoramaGrid& grid, float pitch_rad) {
  return std::max(1, static_cast<int>(std::lround(pitch_rad / grid.step_rad())));
}

SurfaceNodes MakeNodes(const FusedDepth& fused, const PanoramaGrid& grid, int step) {
  MIX_CHECK(step >= 1 && grid.width() % step == 0 && grid.height() % step == 0);
  SurfaceNodes nodes;
  nodes.step = step;
  nodes.width = grid.width() / step;
  nodes.height = grid.height() / step;
  nodes.closed = grid.closed();
  const std::size_t count = static_cast<std::size_t>(nodes.width) * static_cast<std::size_t>(nodes.height);
  nodes.ray.resize(count);
  nodes.inverse_range.assign(count, 0);
  nodes.sigma.assign(count, 0);
  nodes.plane.assign(count, Eigen::Vector3f::Zero());
  nodes.room_plane.assign(count, -1);
  for (int y = 0; y < nodes.height; ++y) {
    for (int x = 0; x < nodes.width; ++x) {
      const auto i = static_cast<std::size_t>(y * nodes.width + x);
      const int cx = x * nodes.step + nodes.step / 2, cy = y * nodes.step + nodes.step / 2;
      nodes.ray[i] = grid.Ray(cx, cy);
      float center = fused.inverse_range(cy, cx), center_sigma = fused.sigma(cy, cx);
      if (center == 0) continue;
      Eigen::Vector3f ray = Eigen::Vector3f::Zero();
      float sum = 0;
      int have = 0;
      for (int v = y * nodes.step; v < (y + 1) * nodes.step; ++v) {
        for (int u = x * nodes.step; u < (x + 1) * nodes.step; ++u) {
          const float value = fused.inverse_range(v, u);
          if (value == 0 || std::abs(value - center) > 3 * std::hypot(center_sigma, fused.sigma(v, u)))
            continue;
          sum += value;
          ray += grid.Ray(u, v);
          ++have;
        }
      }
      nodes.ray[i] = ray / static_cast<float>(have);
      nodes.inverse_range[i] = sum / static_cast<float>(have);
      nodes.sigma[i] = center_sigma;
    }
  }
  return nodes;
}

void DropIslands(SurfaceNodes& nodes) {
  constexpr std::size_t kLeast = 12;
  std::vector<std::uint8_t> done(nodes.ray.size(), 0);
  for (std::size_t start = 0; start < done.size(); ++start) {
    if (done[start] || nodes.inverse_range[start] == 0) continue;
    std::vector<std::size_t> island = {start};
    done[start] = 1;
    std::size_t rim = 0, unseen = 0;
    for (std::size_t next = 0; next < island.size(); ++next) {
      const std::size_t i = island[next];
      for (const auto& [dx, dy] : {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}}) {
        const int at =
            nodes.At(static_cast<int>(i) % nodes.width + dx, static_cast<int>(i) / nodes.width + dy);
        if (at < 0) continue;
        const auto j = static_cast<std::size_t>(at);
        const bool seen = nodes.inverse_range[j] > 0;
        if (seen && std::abs(nodes.inverse_range[j] - nodes.inverse_range[i]) <
                        3 * std::hypot(nodes.sigma[i], nodes.sigma[j])) {
          if (!done[j]) island.push_back(j);
          done[j] = 1;
        } else {
          ++rim;
          unseen += !seen;
        }
      }
    }
    if (island.size() >= kLeast || 2 * unseen < rim) continue;
    for (const std::size_t i : island) nodes.inverse_range[i] = 0;
  }
}

void FitPlanes(SurfaceNodes& nodes) { Fitter(nodes).Run(); }

}  // namespace mixstage
