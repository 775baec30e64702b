// SPDX-License-Identifier: Apache-2.0
#include "server/depth/mesh_warp.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "proto/base/log.h"

namespace mixstage::depth {
namespace {

// What a torn cell hides lies farther than its nearest corner by more than noise and a slope of 79 degrees.
constexpr float kSlopeAcrossCell = 5.0f;

}  // namespace

MeshWarp::MeshWarp(const Rig& rig, DepthSignal signal, const SurfaceCutConfig& cut, double near_m)
    : signal_(std::move(signal)), cut_(signal_, cut), lens_(raster::RasterLens::Of(rig.color, near_m)) {
  const GridShape& shape = cut_.shape();
  rays_.Resize(shape.size());
  corners_.Resize(shape.size());
  const Eigen::Matrix3f R = rig.T_color_depth.linear().cast<float>();
  for (int k = 0; k < 3; ++k) t_color_depth_[k] = static_cast<float>(rig.T_color_depth.translation()[k]);
  for (int y = 0; y < shape.height; ++y) {
    for (int x = 0; x < shape.width; ++x) {
      const cv::Vec2f& ray = signal_.rays()(y, x);
      if (!std::isfinite(ray[0]) || !std::isfinite(ray[1])) continue;  // z is 0 there
      const Eigen::Vector3f in_color = R * Eigen::Vector3f(ray[0], ray[1], 1);
      const auto i = static_cast<std::size_t>(shape.At(x, y));
      rays_.x[i] = in_color.x();
      rays_.y[i] = in_color.y();
      rays_.z[i] = in_color.z();
    }
  }
  const std::ptrdiff_t stride = rig.color.width + raster::kRowPadding;
  inverse_z_.assign(static_cast<std::size_t>(stride) * static_cast<std::size_t>(rig.color.height), 0.0f);
  target_ = {inverse_z_.data(), nullptr, stride, 0, 0, rig.color.width - 1, rig.color.height - 1};
}

void MeshWarp::Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> amplitude,
                   ImageView<float> depth_m) {
  cut_.Run(signal_, raw, amplitude);
  if (egl_ && DrawOnGpu(depth_m)) return;
  DrawSurface();
  EraseBehindEdges();
  for (int y = 0; y < depth_m.height(); ++y) {
    TakeDepth(inverse_z_.data() + y * target_.stride, depth_m.row(y),
              static_cast<std::size_t>(depth_m.width()));
  }
}

Status MeshWarp::Use(const RenderDevice& device) {
  egl_.reset();
  if (device.backend == RasterBackend::kCpu) return {};
  auto egl = EglGridScan::Create(device.gpu, cut_.shape(), target_.x1 + 1, target_.y1 + 1, lens_.near_m);
  if (!egl) return tl::unexpected(egl.error());
  egl_.emplace(std::move(*egl));
  return {};
}

bool MeshWarp::DrawOnGpu(ImageView<float> depth_m) {
  const GridShape& shape = cut_.shape();
  for (int y = 0; y < shape.height; ++y) ProjectRow(y);
  const std::size_t count = PlaceTornCells();
  const Status ok =
      egl_->Draw(corners_, std::span(cut_.cells().data(), shape.size()), torn_.corners, count, depth_m);
  // A lost context is reported by Gpu; what a driver refuses once it will refuse again.
  if (!ok && !reported_ && ok.error().code != ErrorCode::kUnavailable) {
    reported_ = true;
    spdlog::warn("warp_depth event=drawn_on_cpu reason=\"{}\"", ok.error().message);
  }
  return ok.has_value();
}

void MeshWarp::ProjectRow(int y) {
  const GridShape& shape = cut_.shape();
  ProjectCorners(lens_, t_color_depth_, rays_, cut_.z().data(), static_cast<std::size_t>(shape.At(0, y)),
                 static_cast<std::size_t>(shape.width), corners_);
}

void MeshWarp::DrawSurface() {
  const GridShape& shape = cut_.shape();
  for (int y = 0; y < shape.height; ++y) {
    ProjectRow(y);
    if (y == 0) continue;
    // The row of cells above, now that both its rows of corners are there (and still in the cache).
    auto corner = [&](std::ptrdiff_t at) {
      return CellRun::Corner{corners_.x.data() + at, corners_.y.data() + at, corners_.inverse_z.data() + at,
                             corners_.outcode.data() + at};
    };
    const std::ptrdiff_t top = shape.At(0, y - 1);
    const std::ptrdiff_t bottom = shape.At(0, y);
    ScanCells({{corner(top), corner(top + 1), corner(bottom), corner(bottom + 1)},
               cut_.cells().row(y - 1),
               static_cast<std::size_t>(shape.width - 1)},
              target_);
  }
}

// The silhouette runs somewhere through a torn cell, and through parallax the colour camera may see
// background there that the depth camera saw elsewhere: whatever lies behind the cell's nearest corner is
// unknown.
std::size_t MeshWarp::PlaceTornCells() {
  const GridShape& shape = cut_.shape();
  const std::ptrdiff_t offsets[4] = {0, 1, shape.stride(), shape.stride() + 1};
  std::size_t count = 0;
  auto room_for = [&](std::size_t cells) {
    for (int k = 0; k < 4; ++k) {
      torn_.rays[k].Resize(cells);
      torn_.corners[k].Resize(cells);
      torn_.depth_z[k].resize(cells + 8, 0.0f);
    }
    torn_.inverse_z_scale.resize(cells + 8, 0.0f);
    torn_.cells.resize(cells + 8, kWhole);
  };
  const float* z = cut_.z().data();
  const float* median = cut_.median().data();
  const float* limit = cut_.step_limit().data();
  const std::uint8_t* valid = cut_.valid().data();
  for (int y = 0; y + 1 < shape.height; ++y) {
    const std::uint8_t* cells = cut_.cells().row(y);
    const std::size_t most = count + static_cast<std::size_t>(shape.width);
    if (torn_.cells.size() < most + 8) room_for(2 * most);
    for (int x = 0; x + 1 < shape.width; ++x) {
      if ((cells[x] & kTorn) == 0) continue;
      const std::ptrdiff_t at = shape.At(x, y);
      float nearest = std::numeric_limits<float>::max();
      float step = 0;
      // A ring more than the cell's own corners: those may be mixed pixels, half way to the wall.
      for (int dy = -1; dy <= 2; ++dy) {
        for (std::ptrdiff_t i = at + dy * shape.stride() - 1; i < at + dy * shape.stride() + 3; ++i) {
          if (valid[i] == 0 || median[i] >= nearest) continue;
          nearest = median[i];
          step = limit[i];
        }
      }
      if (step == 0) continue;
      const float behind = nearest + step + kSlopeAcrossCell * cut_.pitch() * nearest;
      torn_.inverse_z_scale[count] = nearest / behind;
      for (int k = 0; k < 4; ++k) {
        const auto i = static_cast<std::size_t>(at + offsets[k]);
        // Corners of the nearest surface stay where it was drawn, so that no seam opens between.
        torn_.depth_z[k][count] = valid[i] != 0 && median[i] < behind ? z[i] : nearest;
        torn_.rays[k].x[count] = rays_.x[i];
        torn_.rays[k].y[count] = rays_.y[i];
        torn_.rays[k].z[count] = rays_.z[i];
      }
      ++count;
    }
  }
  for (int k = 0; k < 4; ++k) {
    GridCorners& corners = torn_.corners[k];
    ProjectCorners(lens_, t_color_depth_, torn_.rays[k], torn_.depth_z[k].data(), 0, count, corners);
    // Where the cell is seen is decided by its depth; what lies behind it is what is farther by the margin.
    for (std::size_t i = 0; i < count; ++i) corners.inverse_z[i] *= torn_.inverse_z_scale[i];
  }
  return count;
}

void MeshWarp::EraseBehindEdges() {
  const std::size_t count = PlaceTornCells();
  if (count == 0) return;
  CellRun run{{}, torn_.cells.data(), count};
  for (int k = 0; k < 4; ++k) {
    const GridCorners& corners = torn_.corners[k];
    run.corners[k] = {corners.x.data(), corners.y.data(), corners.inverse_z.data(), corners.outcode.data()};
  }
  EraseBehindCells(run, target_);
}

}  // namespace mixstage::depth
