// SPDX-License-Identifier: Apache-2.0
#include "server/environment/edge_placement.h"

#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "proto/geometry/half_camera.h"

namespace mixstage {
namespace {

constexpr float kStep = 0.04f;  // of inverse depth, between neighbours: an edge
constexpr int kReach = 5;       // pixels to both sides of an edge: what a depth camera's pixel leaves open
constexpr float kNear_px = 3;   // sigma of a neighbour's vote by its distance
constexpr float kColor = 8;     // sigma by its colour, CIE Lab
constexpr float kSure_px = 5;   // so far from an edge depth is trusted wholly, next to it a tenth as much
constexpr float kLeastTrust = 0.1f;
constexpr int kPasses = 2;

cv::Mat Square(int reach) {
  return cv::getStructuringElement(cv::MORPH_RECT, {2 * reach + 1, 2 * reach + 1});
}

// 255 where neighbours step.
cv::Mat1b EdgesOf(const cv::Mat1f& inverse) {
  cv::Mat1f high, low;
  cv::dilate(inverse, high, Square(1));
  cv::erode(inverse, low, Square(1));
  cv::Mat1b edges(inverse.size(), std::uint8_t{0});
  for (int y = 0; y < edges.rows; ++y)
    for (int x = 0; x < edges.cols; ++x)
      edges(y, x) = low(y, x) > 0 && high(y, x) - low(y, x) > kStep * high(y, x) ? 255 : 0;
  return edges;
}

// The two surfaces of an edge around a pixel: each by its pixel that is nearest.
struct TwoSides {
  cv::Point near{-1, -1}, far{-1, -1};
  float middle = 0;  // inverse depth between them
};

// Where the edges are and what is on their sides.
class Edges {
 public:
  explicit Edges(const cv::Mat1f& inverse) : inverse_(inverse), edges_(EdgesOf(inverse)) {
    cv::dilate(edges_, band_, Square(kReach));
    cv::dilate(inverse, high_, Square(kReach));
    cv::erode(inverse, low_, Square(kReach));
  }

  [[nodiscard]] bool Beside(int x, int y) const { return band_(y, x) != 0 && low_(y, x) > 0; }

  [[nodiscard]] std::optional<TwoSides> At(int x, int y) const {
    TwoSides sides;
    sides.middle = (high_(y, x) + low_(y, x)) / 2;
    int to_near = 1 << 20, to_far = 1 << 20;  // squared, px
    for (int v = std::max(0, y - kReach); v <= std::min(inverse_.rows - 1, y + kReach); ++v) {
      for (int u = std::max(0, x - kReach); u <= std::min(inverse_.cols - 1, x + kReach); ++u) {
        const int d2 = (u - x) * (u - x) + (v - y) * (v - y);
        const bool near = inverse_(v, u) > sides.middle;
        if (int& least = near ? to_near : to_far; d2 < least) {
          least = d2;
          (near ? sides.near : sides.far) = {u, v};
        }
      }
    }
    if (sides.near.x < 0 || sides.far.x < 0) return std::nullopt;
    // One slanting surface, not two.
    if (inverse_(sides.near) - inverse_(sides.far) < kStep * inverse_(sides.near)) return std::nullopt;
    return sides;
  }

  // How far depth is to be trusted, kLeastTrust..1.
  [[nodiscard]] cv::Mat1f Trust() const {
    cv::Mat1b smooth;
    cv::bitwise_not(edges_, smooth);
    cv::Mat1f trust;
    cv::distanceTransform(smooth, trust, cv::DIST_L2, 3);
    trust /= kSure_px;
    cv::min(trust, 1, trust);
    cv::max(trust, kLeastTrust, trust);
    return trust;
  }

 private:
  cv::Mat1f inverse_, high_, low_;
  cv::Mat1b edges_, band_;
};

// By squared distance in Lab, a unit each.
const std::array<float, 1024>& ColorWeights() {
  static const std::array<float, 1024> kWeights = [] {
    std::array<float, 1024> weights{};
    for (std::size_t d2 = 0; d2 < weights.size(); ++d2)
      weights[d2] = std::exp(-static_cast<float>(d2) / (2 * kColor * kColor));
    return weights;
  }();
  return kWeights;
}

}  // namespace

cv::Mat1f SnapToColor(const cv::Mat3b& bgr, const cv::Mat1f& inverse_depth) {
  cv::Mat3f light, lab;
  bgr.convertTo(light, CV_32FC3, 1.0 / 255);
  cv::cvtColor(light, lab, cv::COLOR_BGR2Lab);
  const std::array<float, 1024>& color_weight = ColorWeights();
  std::array<float, (2 * kReach + 1) * (2 * kReach + 1)> distance_weight{};
  for (int dy = -kReach; dy <= kReach; ++dy)
    for (int dx = -kReach; dx <= kReach; ++dx)
      distance_weight[static_cast<std::size_t>((dy + kReach) * (2 * kReach + 1) + dx + kReach)] =
          std::exp(-static_cast<float>(dx * dx + dy * dy) / (2 * kNear_px * kNear_px));
  cv::Mat1f now = inverse_depth.clone();
  for (int pass = 0; pass < kPasses; ++pass) {
    const Edges edges(now);
    const cv::Mat1f trust = edges.Trust();
    cv::Mat1f next = now.clone();
    for (int y = 0; y < now.rows; ++y) {
      for (int x = 0; x < now.cols; ++x) {
        if (!edges.Beside(x, y)) continue;
        const std::optional<TwoSides> sides = edges.At(x, y);
        if (!sides) continue;
        const cv::Vec3f own = lab(y, x);
        float near = 0, far = 0;
        for (int v = std::max(0, y - kReach); v <= std::min(now.rows - 1, y + kReach); ++v) {
          for (int u = std::max(0, x - kReach); u <= std::min(now.cols - 1, x + kReach); ++u) {
            const cv::Vec3f d = lab(v, u) - own;
            const auto d2 = static_cast<std::size_t>(d.dot(d));
            if (d2 >= color_weight.size()) continue;
            const float weight = color_weight[d2] * trust(v, u) *
                                 distance_weight[static_cast<std::size_t>(
                                     (v - y + kReach) * (2 * kReach + 1) + u - x + kReach)];
            (now(v, u) > sides->middle ? near : far) += weight;
          }
        }
        const bool is_near = now(y, x) > sides->middle;
        if (near > far && !is_near) next(y, x) = now(sides->near);
        if (near <= far && is_near) next(y, x) = now(sides->far);
      }
    }
    now = next;
  }
  return now;
}

Status PlaceEdges(const SurfaceMesh& draft, const PinholeCamera& camera,
                  const std::vector<PosedPicture>& views, const SurfaceNodes& nodes, const PanoramaGrid& grid,
                  DenseSurface& dense) {
  const PinholeCamera half = HalfCamera(camera);
  auto drawn = DrawDepths(draft, half, views);
  if (!drawn) return tl::unexpected(drawn.error());
  std::vector<cv::Mat1f>& depths = *drawn;
  cv::parallel_for_({0, static_cast<int>(views.size())}, [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      const auto i = static_cast<std::size_t>(k);
      cv::Mat1f inverse(depths[i].size(), 0.f);
      for (int y = 0; y < inverse.rows; ++y)
        for (int x = 0; x < inverse.cols; ++x)
          if (depths[i](y, x) > 0) inverse(y, x) = 1 / depths[i](y, x);
      cv::Mat3b small;
      cv::resize(views[i].bgr, small, inverse.size(), 0, 0, cv::INTER_AREA);
      depths[i] = SnapToColor(small, inverse);
    }
  });

  std::vector<RigidTransform> T_color_world;
  for (const PosedPicture& v : views) T_color_world.push_back(v.T_world_color.inverse());
  const DenseSurface before{dense.inverse_range.clone(), dense.node.clone()};
  const Edges edges(before.inverse_range);
  cv::parallel_for_({0, grid.height()}, [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < grid.width(); ++x) {
        if (!edges.Beside(x, y)) continue;
        const std::optional<TwoSides> sides = edges.At(x, y);
        if (!sides) continue;
        const Eigen::Vector3f ray = grid.Ray(x, y);
        auto carried = [&](const cv::Point& from) {
          const float value = before.inverse_range(from);
          const Eigen::Vector3f& plane = nodes.plane[static_cast<std::size_t>(before.node(from))];
          return std::clamp(value + plane.dot(ray - grid.Ray(from.x, from.y)), 0.9f * value, 1.1f * value);
        };
        const float near = carried(sides->near), far = carried(sides->far);
        const Eigen::Vector3d point = grid.panorama().center + (ray / near).cast<double>();
        // A view that has a surface there sees it; one that looks through it does not; one that sees
        // something before it says nothing.
        const float open = (near - far) / 2 / near;
        int seen = 0;
        for (std::size_t i = 0; i < views.size(); ++i) {
          const Eigen::Vector3d in_view = T_color_world[i] * point;
          const auto pixel = half.Project(in_view);
          if (!pixel) continue;
          const auto u = static_cast<int>(std::lround(pixel->x())),
                     v = static_cast<int>(std::lround(pixel->y()));
          if (u < 0 || v < 0 || u >= depths[i].cols || v >= depths[i].rows || depths[i](v, u) <= 0) continue;
          const float off =
              depths[i](v, u) * static_cast<float>(in_view.z()) - 1;  // > 0: something before it
          if (off > open) continue;
          seen += off > -open ? 1 : -1;
        }
        const bool is_near = before.inverse_range(y, x) > sides->middle;
        if (seen == 0 || (seen > 0) == is_near) continue;
        dense.inverse_range(y, x) = is_near ? far : near;
        dense.node(y, x) = before.node(is_near ? sides->far : sides->near);
      }
    }
  });
  return {};
}

}  // namespace mixstage
