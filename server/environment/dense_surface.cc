// SPDX-License-Identifier: Apache-2.0
#include "server/environment/dense_surface.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

namespace mixstage {
namespace {

// A plane goes on from where it was seen until its range has changed by `most`, then it turns frontal.
Eigen::Vector3f GoOn(const Eigen::Vector3f& plane, const Eigen::Vector3f& from_ray,
                     const Eigen::Vector3f& to_ray, float most) {
  const float from = plane.dot(from_ray), to = plane.dot(to_ray);
  if (to * most > from && to < most * from) return plane;
  return to_ray.normalized() * std::clamp(to, from / most, most * from);
}

constexpr std::array<std::pair<int, int>, 4> kBeside = {{{1, 0}, {-1, 0}, {0, 1}, {0, -1}}};

// Least squares of a plane through nodes' own planes at their rays.
Eigen::Vector3f PlaneThrough(const SurfaceNodes& nodes, const std::vector<int>& rim) {
  Eigen::Matrix3d A = Eigen::Matrix3d::Identity() * 1e-9;
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const int i : rim) {
    const Eigen::Vector3d ray = nodes.ray[static_cast<std::size_t>(i)].cast<double>();
    A += ray * ray.transpose();
    b += nodes.plane[static_cast<std::size_t>(i)].cast<double>().dot(ray) * ray;
  }
  return A.ldlt().solve(b).cast<float>();
}

// A hole whose rim lies on one plane is a part of it: a pane in its frame, a black thing on a wall. Holes
// that reach the picture's end, or whose rim is several surfaces, stay open.
int FillHoles(SurfaceNodes& nodes, std::vector<std::uint8_t>& open) {
  constexpr float kOneSurface = 0.02f;  // of the range
  constexpr std::size_t kLeastRim = 8;
  int filled = 0;
  for (std::size_t start = 0; start < open.size(); ++start) {
    if (!open[start]) continue;
    std::vector<int> hole = {static_cast<int>(start)}, rim;
    open[start] = 0;
    bool closed = true;
    for (std::size_t next = 0; next < hole.size(); ++next) {
      for (const auto& [dx, dy] : kBeside) {
        const int at = nodes.At(hole[next] % nodes.width + dx, hole[next] / nodes.width + dy);
        if (at < 0) {
          closed = false;
        } else if (!nodes.plane[static_cast<std::size_t>(at)].isZero()) {
          rim.push_back(at);
        } else if (open[static_cast<std::size_t>(at)]) {
          open[static_cast<std::size_t>(at)] = 0;
          hole.push_back(at);
        } else if (std::find(hole.begin(), hole.end(), at) == hole.end()) {
          closed = false;  // nobody wants it: outside the sweep
        }
        if (!closed) break;
      }
    }
    std::sort(rim.begin(), rim.end());
    rim.erase(std::unique(rim.begin(), rim.end()), rim.end());
    if (!closed || rim.size() < kLeastRim) continue;
    // Planes through three places of the rim, evenly and reproducibly chosen; then all of the rim that lies
    // on the best.
    std::vector<int> best;
    const std::size_t n = rim.size();
    for (std::size_t k = 0; k < 64; ++k) {
      const std::size_t a = k * 7919 % n, b = (a + n / 3 + k % 5) % n, c = (a + 2 * n / 3 + k % 7) % n;
      const Eigen::Vector3f m = PlaneThrough(nodes, {rim[a], rim[b], rim[c]});
      std::vector<int> on;
      for (const int i : rim) {
        const auto at = static_cast<std::size_t>(i);
        const float own = nodes.plane[at].dot(nodes.ray[at]);
        if (std::abs(m.dot(nodes.ray[at]) - own) < kOneSurface * own) on.push_back(i);
      }
      if (on.size() > best.size()) best = on;
    }
    if (2 * best.size() < n) continue;
    const Eigen::Vector3f m = PlaneThrough(nodes, best);
    for (const int i : hole) {
      const auto at = static_cast<std::size_t>(i);
      if (m.dot(nodes.ray[at]) <= 0) continue;
      nodes.plane[at] = m;
      ++filled;
    }
  }
  return filled;
}

int Spread(SurfaceNodes& nodes, const std::vector<std::uint8_t>& wanted) {
  std::vector<int> front;
  std::vector<int> origin(nodes.plane.size());  // the node that saw what a filled one goes on with
  for (std::size_t i = 0; i < nodes.plane.size(); ++i) {
    origin[i] = static_cast<int>(i);
    if (!nodes.plane[i].isZero()) front.push_back(static_cast<int>(i));
  }
  int filled = 0;
  std::vector<int> next;
  // Rings: every ring sees only those before it, so the order inside one does not matter.
  while (!front.empty()) {
    next.clear();
    std::vector<std::pair<int, int>> takes;  // node, from
    for (const int i : front) {
      const int x = i % nodes.width, y = i / nodes.width;
      for (const auto& [dx, dy] : kBeside) {
        const int at = nodes.At(x + dx, y + dy);
        if (at < 0 || !wanted[static_cast<std::size_t>(at)] ||
            !nodes.plane[static_cast<std::size_t>(at)].isZero())
          continue;
        takes.emplace_back(at, i);
      }
    }
    // Of several the room's planes come first, they surely go on, and of two the nearer hides the other; of
    // things the farther: what is near ends at an edge.
    std::sort(takes.begin(), takes.end(), [&](const auto& a, const auto& b) {
      if (a.first != b.first) return a.first < b.first;
      const auto ia = static_cast<std::size_t>(a.second), ib = static_cast<std::size_t>(b.second);
      const bool pa = nodes.room_plane[ia] >= 0, pb = nodes.room_plane[ib] >= 0;
      if (pa != pb) return pa;
      const Eigen::Vector3f& ray = nodes.ray[static_cast<std::size_t>(a.first)];
      const float ra = nodes.plane[ia].dot(ray), rb = nodes.plane[ib].dot(ray);
      if (ra == rb) return a.second < b.second;
      return pa ? ra > rb : ra < rb;
    });
    for (const auto& [to, from] : takes) {
      const auto t = static_cast<std::size_t>(to), f = static_cast<std::size_t>(from);
      if (!nodes.plane[t].isZero()) continue;
      const auto o = static_cast<std::size_t>(origin[f]);
      // A wall surely goes on; of a cupboard a few tens of degrees of noise may be all that is known of its
      // slant.
      constexpr float kRoom = 1.4f, kThing = 1.15f;
      const Eigen::Vector3f plane =
          GoOn(nodes.plane[o], nodes.ray[o], nodes.ray[t], nodes.room_plane[o] >= 0 ? kRoom : kThing);
      origin[t] = origin[f];
      nodes.room_plane[t] = plane == nodes.plane[o] ? nodes.room_plane[o] : -1;
      nodes.plane[t] = plane;
      next.push_back(to);
      ++filled;
    }
    front.swap(next);
  }
  return filled;
}

struct Candidate {
  float inverse_range = 0, score = 0;
  int node = -1, room_plane = -1;
};

}  // namespace

int FillNodes(SurfaceNodes& nodes, const std::vector<std::uint8_t>& wanted) {
  std::vector<std::uint8_t> open(nodes.plane.size());
  for (std::size_t i = 0; i < open.size(); ++i) open[i] = wanted[i] && nodes.plane[i].isZero();
  return FillHoles(nodes, open) + Spread(nodes, wanted);
}

DenseSurface MakeDense(const SurfaceNodes& nodes, const FusedDepth& fused, const PanoramaGrid& grid) {
  DenseSurface dense;
  dense.inverse_range = cv::Mat1f::zeros(grid.height(), grid.width());
  dense.node = cv::Mat1i(grid.height(), grid.width(), -1);
  const float step = static_cast<float>(nodes.step);
  cv::parallel_for_({0, grid.height()}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < grid.width(); ++x) {
        const Eigen::Vector3f ray = grid.Ray(x, y);
        const int nx = x / nodes.step, ny = y / nodes.step;
        std::array<Candidate, 9> found;
        std::size_t count = 0;
        for (int dy = -1; dy <= 1; ++dy) {
          for (int dx = -1; dx <= 1; ++dx) {
            const int at = nodes.At(nx + dx, ny + dy);
            if (at < 0) continue;
            const auto j = static_cast<std::size_t>(at);
            if (nodes.plane[j].isZero()) continue;
            Candidate c;
            c.inverse_range = nodes.plane[j].dot(ray);
            if (c.inverse_range <= 0) continue;
            c.node = at;
            c.room_plane = nodes.room_plane[j];
            const float off_x = (static_cast<float>(x - (nx + dx) * nodes.step) + 0.5f) / step - 0.5f;
            const float off_y = (static_cast<float>(y - (ny + dy) * nodes.step) + 0.5f) / step - 0.5f;
            c.score = std::exp(-(off_x * off_x + off_y * off_y) / (2 * 0.6f * 0.6f));
            if (fused.inverse_range(y, x) > 0) {
              const float e = (c.inverse_range - fused.inverse_range(y, x)) / fused.sigma(y, x);
              c.score *= std::exp(-0.5f * std::min(e * e, 12.f));
            }
            found[count++] = c;
          }
        }
        if (count == 0) continue;
        // Votes: planes within two per cent of the range are one surface.
        std::size_t best = 0;
        float best_votes = -1;
        for (std::size_t a = 0; a < count; ++a) {
          float votes = 0.25f * found[a].score;
          for (std::size_t b = 0; b < count; ++b) {
            if (std::abs(found[b].inverse_range - found[a].inverse_range) < 0.02f * found[a].inverse_range)
              votes += found[b].score;
          }
          if (votes > best_votes) {
            best_votes = votes;
            best = a;
          }
        }
        Candidate chosen = found[best];
        float value = chosen.inverse_range;
        if (chosen.room_plane < 0) {
          float sum = 0, weight = 0;
          for (std::size_t b = 0; b < count; ++b) {
            if (std::abs(found[b].inverse_range - chosen.inverse_range) >= 0.02f * chosen.inverse_range)
              continue;
            sum += found[b].score * found[b].inverse_range;
            weight += found[b].score;
          }
          value = weight > 0 ? sum / weight : value;
        } else {
          for (std::size_t b = 0; b < count; ++b) {
            const Candidate& o = found[b];
            if (o.room_plane < 0 || o.room_plane == chosen.room_plane) continue;
            if (std::abs(o.inverse_range - chosen.inverse_range) > 0.05f * chosen.inverse_range) continue;
            // In an inner corner each plane ends where the other comes nearer, at an outer edge where it goes
            // behind.
            const Eigen::Vector3f& own_ray = nodes.ray[static_cast<std::size_t>(chosen.node)];
            const Eigen::Vector3f& own = nodes.plane[static_cast<std::size_t>(chosen.node)];
            const Eigen::Vector3f& other = nodes.plane[static_cast<std::size_t>(o.node)];
            const bool inner = own.dot(own_ray) > other.dot(own_ray);
            if (inner ? o.inverse_range > value : o.inverse_range < value) {
              value = o.inverse_range;
              chosen.node = o.node;
            }
          }
        }
        dense.inverse_range(y, x) = value;
        dense.node(y, x) = chosen.node;
      }
    }
  });
  return dense;
}

}  // namespace mixstage
