// SPDX-License-Identifier: Apache-2.0
#include "server/environment/surface_mesh.h"

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

namespace mixstage {
namespace {

// An edge may move by `error`; range, on which a texture's place hangs, by so many times less.
constexpr float kRangeWeight = 20;

class Mesher {
 public:
  Mesher(const DenseSurface& dense, const SurfaceNodes& nodes, const PanoramaGrid& grid,
         const SurfaceMeshConfig& config)
      : d_(dense),
        n_(nodes),
        grid_(grid),
        config_(config),
        pixel_vertex_(dense.inverse_range.total(), kNone) {}

  SurfaceMesh Run() {
    const int w = grid_.width(), last = grid_.closed() ? w : w - 1;
    for (int y = 0; y + 1 < grid_.height(); ++y)
      for (int x = 0; x < last; ++x) Cell(x, y);
    return Reduce();
  }

 private:
  static constexpr std::uint32_t kNone = ~0u;

  // A corner: column (may be one beyond a closed picture's right edge), row, in grid pixels, and inverse
  // range.
  struct Vertex {
    float u = 0, v = 0, inverse_range = 0;
  };

  [[nodiscard]] float InverseRange(int x, int y) const { return d_.inverse_range(y, x % grid_.width()); }
  [[nodiscard]] int Node(int x, int y) const { return d_.node(y, x % grid_.width()); }
  [[nodiscard]] Eigen::Vector3f Ray(int x, int y) const { return grid_.Ray(x % grid_.width(), y); }

  // One surface: a short step, or each lies where the other's plane goes on to.
  [[nodiscard]] bool Joined(int ax, int ay, int bx, int by) const {
    const float a = InverseRange(ax, ay), b = InverseRange(bx, by);
    if (std::abs(1 / a - 1 / b) <= config_.cut_m) return true;
    const int na = Node(ax, ay), nb = Node(bx, by);
    if (na < 0 || nb < 0) return false;
    const float a_at_b = n_.plane[static_cast<std::size_t>(na)].dot(Ray(bx, by));
    const float b_at_a = n_.plane[static_cast<std::size_t>(nb)].dot(Ray(ax, ay));
    if (a_at_b <= 0 || b_at_a <= 0) return false;
    return std::abs(1 / a_at_b - 1 / b) <= config_.cut_m && std::abs(1 / b_at_a - 1 / a) <= config_.cut_m;
  }

  std::uint32_t PixelVertex(int x, int y) {
    // A closed picture's last column joins the first at the texture's other edge: its own corner.
    if (x >= grid_.width()) return Add({static_cast<float>(x), static_cast<float>(y), InverseRange(x, y)});
    std::uint32_t& at = pixel_vertex_[static_cast<std::size_t>(y * grid_.width() + x)];
    if (at == kNone) at = Add({static_cast<float>(x), static_cast<float>(y), InverseRange(x, y)});
    return at;
  }
  std::uint32_t Add(const Vertex& v) {
    vertices_.push_back(v);
    return static_cast<std::uint32_t>(vertices_.size() - 1);
  }

  // What the plane of pixel p says at another place of the grid.
  [[nodiscard]] float GoOn(const cv::Point& p, float u, float v) const {
    const float own = InverseRange(p.x, p.y);
    const int node = Node(p.x, p.y);
    if (node < 0) return own;
    const Eigen::Vector3d ray = grid_.panorama().Ray(u, v);
    const float there = n_.plane[static_cast<std::size_t>(node)].dot(ray.cast<float>());
    const float here = n_.plane[static_cast<std::size_t>(node)].dot(Ray(p.x, p.y));
    return std::clamp(own + there - here, 0.8f * own, 1.25f * own);
  }

  void Triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    indices_.insert(indices_.end(), {a, b, c});
  }

  void Cell(int x, int y) {
    const std::array<cv::Point, 4> p = {cv::Point(x, y), {x + 1, y}, {x, y + 1}, {x + 1, y + 1}};
    std::array<int, 4> surface{};  // surfaces of the cell, 0.. ; -1 = not known
    std::array<float, 4> value{};
    int surfaces = 0, known = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      value[k] = InverseRange(p[k].x, p[k].y);
      known += value[k] > 0;
    }
    if (known < 3) return;
    for (std::size_t k = 0; k < 4; ++k) {
      surface[k] = -1;
      if (value[k] <= 0) continue;
      for (std::size_t j = 0; j < k && surface[k] < 0; ++j)
        if (surface[j] >= 0 && Joined(p[k].x, p[k].y, p[j].x, p[j].y)) surface[k] = surface[j];
      if (surface[k] < 0) surface[k] = surfaces++;
    }
    if (surfaces == 1) {
      std::array<std::uint32_t, 4> v{};
      for (std::size_t k = 0; k < 4; ++k)
        if (surface[k] == 0) v[k] = PixelVertex(p[k].x, p[k].y);
      // Rows run down and columns to the right: counter-clockwise from the centre is (right, then up).
      if (known == 4) {
        Triangle(v[0], v[2], v[1]);
        Triangle(v[1], v[2], v[3]);
      } else if (surface[0] < 0) {
        Triangle(v[1], v[2], v[3]);
      } else if (surface[1] < 0) {
        Triangle(v[0], v[2], v[3]);
      } else if (surface[2] < 0) {
        Triangle(v[0], v[3], v[1]);
      } else {
        Triangle(v[0], v[2], v[1]);
      }
      return;
    }
    float farthest = value[0];
    for (const float v : value)
      if (v > 0) farthest = std::min(farthest, v);
    for (int s = 0; s < surfaces; ++s) TornCell(p, value, surface, s, farthest);
  }

  // One surface of a torn cell: the farthest fills it, a nearer one ends half way to the others' corners.
  void TornCell(const std::array<cv::Point, 4>& p, const std::array<float, 4>& value,
                const std::array<int, 4>& surface, int s, float farthest) {
    bool is_farthest = false;
    for (std::size_t k = 0; k < 4; ++k) is_farthest |= surface[k] == s && value[k] == farthest;
    std::array<std::uint32_t, 4> v{};
    for (std::size_t k = 0; k < 4; ++k) {
      if (surface[k] == s) {
        v[k] = PixelVertex(p[k].x, p[k].y);
        continue;
      }
      // The nearest own corner: along the row, the column, else across.
      std::size_t own = k ^ 1u;
      if (surface[own] != s) own = k ^ 2u;
      if (surface[own] != s) own = k ^ 3u;
      const float share = is_farthest ? 1.f : 0.5f;
      const float u = static_cast<float>(p[own].x) + share * static_cast<float>(p[k].x - p[own].x);
      const float w = static_cast<float>(p[own].y) + share * static_cast<float>(p[k].y - p[own].y);
      // The same corner from the cells beside: one vertex.
      const std::uint64_t key =
          ((static_cast<std::uint64_t>(p[own].y) * 65536 + static_cast<std::uint64_t>(p[own].x)) << 5) |
          static_cast<std::uint64_t>((p[k].y - p[own].y + 1) * 6 + (p[k].x - p[own].x + 1) * 2 + is_farthest);
      const auto [found, added] = moved_.try_emplace(key, 0u);
      if (added) found->second = Add({u, w, GoOn(p[own], u, w)});
      v[k] = found->second;
    }
    Triangle(v[0], v[2], v[1]);
    Triangle(v[1], v[2], v[3]);
  }

  // First tile by tile with their borders held (small, and side by side on the cores), then the rest as a
  // whole.
  void Simplify() {
    const auto step = static_cast<float>(grid_.step_rad());
    std::vector<Eigen::Vector3f> place(vertices_.size());
    for (std::size_t i = 0; i < place.size(); ++i) {
      const Vertex& v = vertices_[i];
      place[i] = {v.u * step, v.v * step, -kRangeWeight * std::log(v.inverse_range)};
    }
    constexpr int kTile = 96;
    const int across = grid_.width() / kTile + 1, down = grid_.height() / kTile + 1;
    std::vector<std::vector<std::uint32_t>> tiles(static_cast<std::size_t>(across * down));
    for (std::size_t i = 0; i + 2 < indices_.size(); i += 3) {
      float u = vertices_[indices_[i]].u, v = vertices_[indices_[i]].v;
      for (std::size_t k = 1; k < 3; ++k) {
        u = std::min(u, vertices_[indices_[i + k]].u);
        v = std::min(v, vertices_[indices_[i + k]].v);
      }
      auto& tile =
          tiles[static_cast<std::size_t>(static_cast<int>(v) / kTile * across + static_cast<int>(u) / kTile)];
      tile.insert(tile.end(), indices_.begin() + static_cast<std::ptrdiff_t>(i),
                  indices_.begin() + static_cast<std::ptrdiff_t>(i + 3));
    }
    cv::parallel_for_({0, across * down}, [&](const cv::Range& range) {
      for (int t = range.start; t < range.end; ++t) {
        auto& tile = tiles[static_cast<std::size_t>(t)];
        SimplifyPart(place, tile, 0, meshopt_SimplifyLockBorder);
      }
    });
    indices_.clear();
    for (const auto& tile : tiles) indices_.insert(indices_.end(), tile.begin(), tile.end());
    SimplifyPart(place, indices_, 0, 0);
    if (indices_.size() > 3 * config_.most_triangles)
      SimplifyPart(place, indices_, config_.most_triangles, 0);
  }

  // Down to `triangles` at any error, or, where that is 0, as far as config_.error allows.
  void SimplifyPart(const std::vector<Eigen::Vector3f>& place, std::vector<std::uint32_t>& part,
                    std::size_t triangles, unsigned options) const {
    if (part.empty()) return;
    std::vector<std::uint32_t> used = part;
    std::sort(used.begin(), used.end());
    used.erase(std::unique(used.begin(), used.end()), used.end());
    std::vector<Eigen::Vector3f> local;
    local.reserve(used.size());
    for (const std::uint32_t i : used) local.push_back(place[i]);
    std::vector<std::uint32_t> from(part.size()), to(part.size());
    for (std::size_t k = 0; k < part.size(); ++k)
      from[k] =
          static_cast<std::uint32_t>(std::lower_bound(used.begin(), used.end(), part[k]) - used.begin());
    const float scale = meshopt_simplifyScale(local[0].data(), local.size(), sizeof(Eigen::Vector3f));
    const float error = triangles > 0 ? 1.f : static_cast<float>(config_.error) / std::max(scale, 1e-9f);
    const std::size_t count =
        meshopt_simplify(to.data(), from.data(), from.size(), local[0].data(), local.size(),
                         sizeof(Eigen::Vector3f), 3 * triangles, error, options, nullptr);
    part.resize(count);
    for (std::size_t k = 0; k < count; ++k) part[k] = used[to[k]];
  }

  SurfaceMesh Reduce() {
    SurfaceMesh mesh;
    if (indices_.empty()) return mesh;
    if (config_.error > 0) Simplify();
    TurnTowardsCenter();
    const Panorama& panorama = grid_.panorama();
    std::vector<std::uint32_t> number(vertices_.size(), kNone);
    for (std::uint32_t& index : indices_) {
      std::uint32_t& at = number[index];
      if (at == kNone) {
        at = static_cast<std::uint32_t>(mesh.positions.size());
        const Vertex& v = vertices_[index];
        mesh.positions.emplace_back(
            (panorama.center + panorama.Ray(v.u, v.v) / v.inverse_range).cast<float>());
        mesh.uvs.emplace_back((v.u + 0.5f) / static_cast<float>(panorama.width),
                              (v.v + 0.5f) / static_cast<float>(panorama.height));
      }
      mesh.indices.push_back(at);
    }
    return mesh;
  }

  // Reduced slivers at edges may have turned over; what has no area goes.
  void TurnTowardsCenter() {
    std::size_t out = 0;
    for (std::size_t i = 0; i + 2 < indices_.size(); i += 3) {
      std::array<std::uint32_t, 3> t = {indices_[i], indices_[i + 1], indices_[i + 2]};
      const Vertex &a = vertices_[t[0]], &b = vertices_[t[1]], &c = vertices_[t[2]];
      const float turn = (b.u - a.u) * (c.v - a.v) - (b.v - a.v) * (c.u - a.u);
      if (turn == 0) continue;
      if (turn > 0) std::swap(t[1], t[2]);  // rows run down
      for (const std::uint32_t index : t) indices_[out++] = index;
    }
    indices_.resize(out);
  }

  const DenseSurface& d_;
  const SurfaceNodes& n_;
  const PanoramaGrid& grid_;
  const SurfaceMeshConfig config_;
  std::vector<std::uint32_t> pixel_vertex_;
  std::unordered_map<std::uint64_t, std::uint32_t> moved_;
  std::vector<Vertex> vertices_;
  std::vector<std::uint32_t> indices_;
};

}  // namespace

SurfaceMesh MakeSurfaceMesh(const DenseSurface& dense, const SurfaceNodes& nodes, const PanoramaGrid& grid,
                            const SurfaceMeshConfig& config) {
  return Mesher(dense, nodes, grid, config).Run();
}

}  // namespace mixstage
