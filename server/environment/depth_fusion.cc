// SPDX-License-Identifier: Apache-2.0
#include "server/environment/depth_fusion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// A surface is drawn through neighbours that a slant of 80 degrees explains.
constexpr float kSteepest = 5.7f;
constexpr float kSigmas = 4;

struct Corner {
  Eigen::Vector2f at;  // patch pixels
  float inverse_range = 0, sigma = 0, range_m = 0;
};

bool Torn(const Corner& a, const Corner& b, float sigma_a_m, float sigma_b_m, float pitch_rad) {
  const float step = std::abs(a.range_m - b.range_m);
  const float nearer = std::min(a.range_m, b.range_m);
  return step > kSigmas * std::hypot(sigma_a_m, sigma_b_m) + nearer * pitch_rad * kSteepest;
}

void DrawTriangle(const std::array<const Corner*, 3>& c, bool torn, PanoramaPatch& patch) {
  const Eigen::Vector2f a = c[0]->at, ab = c[1]->at - a, ac = c[2]->at - a;
  const float area = ab.x() * ac.y() - ab.y() * ac.x();
  if (!(area > 1e-6f)) return;  // seen from behind, or nothing
  const auto [min_x, max_x] = std::minmax({c[0]->at.x(), c[1]->at.x(), c[2]->at.x()});
  const auto [min_y, max_y] = std::minmax({c[0]->at.y(), c[1]->at.y(), c[2]->at.y()});
  const int x_end = std::min(patch.inverse_range.cols - 1, static_cast<int>(std::floor(max_x)));
  const int y_end = std::min(patch.inverse_range.rows - 1, static_cast<int>(std::floor(max_y)));
  constexpr float kEdge = -1e-4f;
  for (int y = std::max(0, static_cast<int>(std::ceil(min_y))); y <= y_end; ++y) {
    for (int x = std::max(0, static_cast<int>(std::ceil(min_x))); x <= x_end; ++x) {
      const Eigen::Vector2f p(static_cast<float>(x) - a.x(), static_cast<float>(y) - a.y());
      const float w1 = (p.x() * ac.y() - p.y() * ac.x()) / area,
                  w2 = (ab.x() * p.y() - ab.y() * p.x()) / area;
      const float w0 = 1 - w1 - w2;
      if (w0 < kEdge || w1 < kEdge || w2 < kEdge) continue;
      float inverse_range = 0, sigma = 0;
      if (torn) {
        const Corner& nearest = *c[w0 >= w1 && w0 >= w2 ? 0 : w1 >= w2 ? 1 : 2];
        inverse_range = nearest.inverse_range;
        sigma = nearest.sigma;
      } else {
        inverse_range = w0 * c[0]->inverse_range + w1 * c[1]->inverse_range + w2 * c[2]->inverse_range;
        sigma = w0 * c[0]->sigma + w1 * c[1]->sigma + w2 * c[2]->sigma;
      }
      float& drawn = patch.inverse_range(y, x);
      if (inverse_range <= drawn) continue;
      drawn = inverse_range;
      patch.sigma(y, x) = sigma;
    }
  }
}

}  // namespace

PanoramaPatch SeeFromCenter(const RangeView& view, const RangeCamera& camera,
                            const RigidTransform& T_world_depth, const PanoramaGrid& grid) {
  const int w = view.range_m.cols, h = view.range_m.rows;
  MIX_CHECK(camera.ray.cols == w && camera.ray.rows == h);
  const Eigen::Vector3d center = grid.panorama().center;
  const double u_axis = grid.PixelNear(T_world_depth.linear().col(2), grid.width() / 2.0).x();
  std::vector<Corner> corners(view.range_m.total());
  Eigen::Vector2f least(1e9f, 1e9f), most(-1e9f, -1e9f);
  for (int y = 0; y < h; ++y) {
    for (int x = 0; x < w; ++x) {
      const float range_m = view.range_m(y, x);
      if (range_m <= 0) continue;
      const cv::Vec3f n = camera.ray(y, x);
      const Eigen::Vector3d p =
          T_world_depth * (range_m * Eigen::Vector3f(n[0], n[1], n[2])).cast<double>() - center;
      const double length = p.norm();
      if (length < 1e-3) continue;
      Corner& corner = corners[static_cast<std::size_t>(y * w + x)];
      corner.at = grid.PixelNear(p, u_axis).cast<float>();
      corner.range_m = range_m;
      corner.inverse_range = static_cast<float>(1 / length);
      corner.sigma = view.sigma_m(y, x) * corner.inverse_range * corner.inverse_range;
      least = least.cwiseMin(corner.at);
      most = most.cwiseMax(corner.at);
    }
  }
  PanoramaPatch patch;
  if (least.x() > most.x()) return patch;
  const int limit_x = grid.closed() ? 1 << 24 : grid.width() - 1;
  patch.x0 = std::max(grid.closed() ? -limit_x : 0, static_cast<int>(std::ceil(least.x())));
  patch.y0 = std::max(0, static_cast<int>(std::ceil(least.y())));
  const int x1 =
      std::min({limit_x, static_cast<int>(most.x()), patch.x0 + static_cast<int>(grid.turn_px()) - 1});
  const int y1 = std::min(grid.height() - 1, static_cast<int>(most.y()));
  if (x1 < patch.x0 || y1 < patch.y0) return patch;
  patch.inverse_range = cv::Mat1f::zeros(y1 - patch.y0 + 1, x1 - patch.x0 + 1);
  patch.sigma = cv::Mat1f::zeros(patch.inverse_range.size());
  const Eigen::Vector2f origin(static_cast<float>(patch.x0), static_cast<float>(patch.y0));
  for (Corner& corner : corners) corner.at -= origin;
  const float widest =
      static_cast<float>(grid.turn_px() / 6);  // a cell across the zenith covers no such area
  for (int y = 0; y + 1 < h; ++y) {
    for (int x = 0; x + 1 < w; ++x) {
      const auto i = static_cast<std::size_t>(y * w + x);
      const std::array<std::size_t, 4> at = {i, i + 1, i + static_cast<std::size_t>(w),
                                             i + static_cast<std::size_t>(w) + 1};
      // The shorter diagonal in range: a cell with one corner on another surface keeps the other three.
      const bool falling = std::abs(corners[at[0]].range_m - corners[at[3]].range_m) <=
                           std::abs(corners[at[1]].range_m - corners[at[2]].range_m);
      const std::array<std::array<std::size_t, 3>, 2> triangles =
          falling ? std::array<std::array<std::size_t, 3>, 2>{{{0, 1, 3}, {0, 3, 2}}}
                  : std::array<std::array<std::size_t, 3>, 2>{{{0, 1, 2}, {1, 3, 2}}};
      for (const auto& t : triangles) {
        std::array<const Corner*, 3> c{};
        bool whole = true, torn = false;
        for (std::size_t k = 0; k < 3; ++k) {
          c[k] = &corners[at[t[k]]];
          whole &= c[k]->range_m > 0;
        }
        if (!whole) continue;
        for (std::size_t k = 0; k < 3; ++k) {
          const std::size_t a = at[t[k]], b = at[t[(k + 1) % 3]];
          torn |= Torn(corners[a], corners[b], view.sigma_m(static_cast<int>(a) / w, static_cast<int>(a) % w),
                       view.sigma_m(static_cast<int>(b) / w, static_cast<int>(b) % w), camera.pitch_rad);
          whole &= std::abs(c[k]->at.x() - c[(k + 1) % 3]->at.x()) < widest;
        }
        if (whole) DrawTriangle(c, torn, patch);
      }
    }
  }
  return patch;
}

FusedDepth Fuse(const std::vector<PanoramaPatch>& patches, const PanoramaGrid& grid) {
  FusedDepth fused;
  const cv::Size size(grid.width(), grid.height());
  fused.inverse_range = cv::Mat1f::zeros(size);
  fused.sigma = cv::Mat1f::zeros(size);
  fused.views = cv::Mat1b::zeros(size);
  struct Sight {
    float inverse_range, sigma, weight;
  };
  // Rows are independent; per row the views that reach it.
  cv::parallel_for_({0, size.height}, [&](const cv::Range& rows) {
    std::vector<std::vector<Sight>> sights(static_cast<std::size_t>(size.width));
    for (int y = rows.start; y < rows.end; ++y) {
      for (auto& s : sights) s.clear();
      for (const PanoramaPatch& p : patches) {
        const int py = y - p.y0;
        if (py < 0 || py >= p.inverse_range.rows) continue;
        for (int px = 0; px < p.inverse_range.cols; ++px) {
          const float value = p.inverse_range(py, px);
          const int x = value > 0 ? grid.Column(p.x0 + px) : -1;
          if (x < 0) continue;
          const float sigma = p.sigma(py, px);
          sights[static_cast<std::size_t>(x)].push_back({value, sigma, 1 / (sigma * sigma)});
        }
      }
      for (int x = 0; x < size.width; ++x) {
        auto& seen = sights[static_cast<std::size_t>(x)];
        if (seen.empty()) continue;
        const auto agree_with = [](const Sight& a, const Sight& b) {
          return std::abs(a.inverse_range - b.inverse_range) <= 3 * std::hypot(a.sigma, b.sigma);
        };
        // Votes, not weights: inverse variance would let one view that looks past a thing outvote those that
        // see it.
        std::size_t best = 0;
        std::pair<int, float> most{0, 0.f};
        for (std::size_t i = 0; i < seen.size(); ++i) {
          std::pair<int, float> votes{0, 0.f};
          for (const Sight& s : seen) {
            if (!agree_with(s, seen[i])) continue;
            ++votes.first;
            votes.second += s.weight;
          }
          if (votes > most) {
            most = votes;
            best = i;
          }
        }
        float sum = 0, weight = 0;
        int agree = 0;
        for (const Sight& s : seen) {
          if (!agree_with(s, seen[best])) continue;
          sum += s.weight * s.inverse_range;
          weight += s.weight;
          ++agree;
        }
        fused.inverse_range(y, x) = sum / weight;
        fused.sigma(y, x) = 1 / std::sqrt(weight);
        fused.views(y, x) = static_cast<std::uint8_t>(std::min(agree, 255));
      }
    }
  });
  return fused;
}

}  // namespace mixstage
