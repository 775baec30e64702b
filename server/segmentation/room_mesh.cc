// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/room_mesh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr float kSteepest = 5.1f;  // tangent of 79 degrees: floors seen from standing height, to 5 m a metre
// Slope that a neighbouring edge explains: perspective makes the next one longer.
constexpr float kSlopeGrowth = 1.5f;
constexpr std::uint32_t kNone = ~0u;

// Every stride-th quarter pixel.
class RoomGrid {
 public:
  RoomGrid(const BackgroundModel& room, const PinholeCamera& color, const RoomMeshConfig& config, int stride)
      : room_(room), color_(color), config_(config), stride_(stride) {
    columns_ = (room.room_depth_m.cols - 1) / stride + 1;
    rows_ = (room.room_depth_m.rows - 1) / stride + 1;
    pitch_ = static_cast<float>(4 * stride / std::min(color.fx, color.fy));
  }

  PictureMesh Mesh(const RigidTransform& T_scene_color) {
    vertices_.assign(static_cast<std::size_t>(rows_) * static_cast<std::size_t>(columns_), kNone);
    mesh_.crop = cv::Rect(0, 0, room_.width, room_.height);
    T_scene_color_ = T_scene_color;
    for (int j = 0; j + 1 < rows_; ++j) {
      for (int i = 0; i + 1 < columns_; ++i) AddCell(i, j);
    }
    return std::move(mesh_);
  }

 private:
  struct Place {
    int i, j;
  };

  [[nodiscard]] float Depth(int i, int j) const {
    if (i < 0 || j < 0 || i >= columns_ || j >= rows_) return 0;
    return room_.room_depth_m(j * stride_, i * stride_);
  }

  // Of the edge from a to b = a + (di, dj): nothing where a depth is not known.
  [[nodiscard]] std::optional<float> Rise(int i, int j, int di, int dj) const {
    const float a = Depth(i, j), b = Depth(i + di, j + dj);
    if (a <= 0 || b <= 0) return std::nullopt;
    return b - a;
  }

  [[nodiscard]] bool Joined(Place a, Place b) const {
    const int di = b.i - a.i, dj = b.j - a.j;
    const auto rise = Rise(a.i, a.j, di, dj);
    if (!rise) return false;
    // The slope of the flatter side: a step's own edge is steep and would explain itself.
    const auto before = Rise(a.i - di, a.j - dj, di, dj), after = Rise(b.i, b.j, di, dj);
    float slope_rise = 0;
    if (before && after) {
      slope_rise = std::min(std::abs(*before), std::abs(*after));
    } else if (before || after) {
      slope_rise = std::abs(before ? *before : *after);
    }
    const float step_per_slope = std::min(Depth(a.i, a.j), Depth(b.i, b.j)) * pitch_;
    const float slope = std::min(slope_rise / step_per_slope, kSteepest);
    const float sigma =
        std::max(room_.sigma_m(a.j * stride_, a.i * stride_), room_.sigma_m(b.j * stride_, b.i * stride_));
    const float noise = config_.step_sigmas * sigma * std::sqrt(1 + slope * slope);  // 1 / cos
    return std::abs(*rise) <= kSlopeGrowth * slope * step_per_slope + std::max(config_.step_m, noise);
  }

  // Two triangles, or the one that has no torn edge. Corners go round against the clock.
  void AddCell(int i, int j) {
    const std::array<Place, 4> corner = {Place{i, j}, {i, j + 1}, {i + 1, j + 1}, {i + 1, j}};
    std::array<bool, 4> joined{};
    for (std::size_t k = 0; k < 4; ++k) joined[k] = Joined(corner[k], corner[(k + 1) % 4]);
    const auto step = [&](std::size_t a, std::size_t b) {
      return std::abs(Depth(corner[a].i, corner[a].j) - Depth(corner[b].i, corner[b].j));
    };
    if (joined[0] && joined[1] && joined[2] && joined[3]) {
      const std::size_t k = step(0, 2) <= step(1, 3) ? 0 : 1;
      AddTriangle(corner[k], corner[k + 1], corner[k + 2]);
      AddTriangle(corner[k], corner[k + 2], corner[(k + 3) % 4]);
      return;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      if (!joined[k] || !joined[(k + 1) % 4]) continue;
      AddTriangle(corner[k], corner[(k + 1) % 4], corner[(k + 2) % 4]);
      return;
    }
  }

  void AddTriangle(Place a, Place b, Place c) {
    const std::array<std::uint32_t, 3> triangle = {VertexOf(a), VertexOf(b), VertexOf(c)};
    if (std::find(triangle.begin(), triangle.end(), kNone) != triangle.end()) return;
    mesh_.indices.insert(mesh_.indices.end(), triangle.begin(), triangle.end());
  }

  // kNone where the lens has no ray.
  std::uint32_t VertexOf(Place p) {
    std::uint32_t& vertex = vertices_[static_cast<std::size_t>(p.j) * static_cast<std::size_t>(columns_) +
                                      static_cast<std::size_t>(p.i)];
    if (vertex != kNone) return vertex;
    // QuarterDepth takes the second of four pixels.
    const double u = 4 * p.i * stride_ + 1, v = 4 * p.j * stride_ + 1;
    const auto ray = color_.Unproject({u, v});
    if (!ray) return kNone;
    const double z = Depth(p.i, p.j);
    mesh_.positions.emplace_back(
        (T_scene_color_ * Eigen::Vector3d(ray->x() * z, ray->y() * z, z)).cast<float>());
    mesh_.uvs.emplace_back(static_cast<float>((u + 0.5) / room_.width),
                           static_cast<float>((v + 0.5) / room_.height));
    return vertex = static_cast<std::uint32_t>(mesh_.positions.size() - 1);
  }

  const BackgroundModel& room_;
  const PinholeCamera& color_;
  const RoomMeshConfig& config_;
  int stride_, columns_ = 0, rows_ = 0;
  float pitch_ = 0;  // metres between neighbours of the grid at 1 m
  RigidTransform T_scene_color_ = RigidTransform::Identity();
  std::vector<std::uint32_t> vertices_;
  PictureMesh mesh_;
};

}  // namespace

PictureMesh MakeRoomMesh(const BackgroundModel& room, const PinholeCamera& color,
                         const RigidTransform& T_scene_color, const RoomMeshConfig& config) {
  MIX_CHECK(room.width == color.width && room.height == color.height);
  MIX_CHECK(config.max_triangles > 0 && config.step_m > 0 && config.step_sigmas > 0);
  if (!room.has_depth()) return {};
  const auto cells = [&](int stride) {
    return static_cast<std::size_t>((room.room_depth_m.cols - 1) / stride) *
           static_cast<std::size_t>((room.room_depth_m.rows - 1) / stride);
  };
  int stride = 1;
  while (2 * cells(stride) > config.max_triangles) ++stride;
  return RoomGrid(room, color, config, stride).Mesh(T_scene_color);
}

YuvImage RoomPicture(const BackgroundModel& room) {
  cv::Mat3b bgr(room.mean[0].size());
  for (int y = 0; y < bgr.rows; ++y) {
    for (int x = 0; x < bgr.cols; ++x) {
      for (int c = 0; c < 3; ++c)
        bgr(y, x)[c] = cv::saturate_cast<std::uint8_t>(room.mean[static_cast<std::size_t>(2 - c)](y, x));
    }
  }
  return FromBgr(bgr, ChromaLayout::k420);
}

}  // namespace mixstage
