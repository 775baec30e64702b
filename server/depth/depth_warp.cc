// SPDX-License-Identifier: Apache-2.0
#include "server/depth/depth_warp.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "server/depth/depth_signal.h"
#include "server/depth/mesh_warp.h"

namespace mixstage {
namespace {

constexpr double kMostColorPxPerDepthPx = 40;  // the scan takes cells up to 60 px; parallax stretches them
constexpr double kAspectTolerance = 0.01;

std::string Size(int width, int height) { return std::to_string(width) + "x" + std::to_string(height); }

Status CheckSize(const std::string& what, int width, int height, const std::string& field,
                 const PinholeCamera& c) {
  if (width == c.width && height == c.height) return {};
  return Fail(ErrorCode::kBadInput, what + " is " + Size(width, height) + " where the rig's " + field +
                                        " says " + Size(c.width, c.height) +
                                        ": wrong rig.json for this camera");
}

}  // namespace

class DepthWarp::Way {
 public:
  virtual ~Way() = default;
  virtual Status Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> amplitude,
                     ImageView<float> depth_m) = 0;
};

class DepthWarp::MeshWay final : public DepthWarp::Way {
 public:
  MeshWay(const Rig& rig, DepthSignal signal, const DepthWarpConfig& config)
      : depth_(rig.depth->camera),
        color_(rig.color),
        warp_(rig, std::move(signal), {.step_sigmas = static_cast<float>(config.edge_sigmas)},
              config.near_m) {}
  Status Use(const RenderDevice& device) { return warp_.Use(device); }

  Status Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> amplitude,
             ImageView<float> depth_m) override {
    if (auto ok = CheckSize("depth picture", raw.width(), raw.height(), "cameras.depth", depth_); !ok)
      return ok;
    if (!amplitude.empty()) {
      auto ok =
          CheckSize("amplitude picture", amplitude.width(), amplitude.height(), "cameras.depth", depth_);
      if (!ok) return ok;
    }
    if (auto ok = CheckSize("colour picture", depth_m.width(), depth_m.height(), "cameras.color", color_);
        !ok) {
      return ok;
    }
    warp_.Run(raw, amplitude, depth_m);
    return {};
  }

 private:
  const PinholeCamera depth_, color_;
  depth::MeshWarp warp_;
};

class DepthWarp::RegisteredWay final : public DepthWarp::Way {
 public:
  RegisteredWay(const PinholeCamera& color, DepthSignal signal, double max_depth_m)
      : color_(color), signal_(std::move(signal)), max_depth_m_(static_cast<float>(max_depth_m)) {}

  Status Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> /*amplitude*/,
             ImageView<float> depth_m) override {
    if (auto ok = CheckSize("colour picture", depth_m.width(), depth_m.height(), "cameras.color", color_);
        !ok) {
      return ok;
    }
    const double across = double{1} * raw.width() * color_.height;
    const double along = double{1} * raw.height() * color_.width;
    if (raw.empty() || std::abs(across - along) > kAspectTolerance * std::max(across, along)) {
      return Fail(ErrorCode::kBadInput, "registered depth picture is " + Size(raw.width(), raw.height()) +
                                            ", which has not the shape of the colour picture, " +
                                            Size(color_.width, color_.height));
    }
    // Pixel centres are integers: u + 0.5 of the width stands for (u + 0.5) w_depth / w_color of the other.
    auto nearest = [](int u, int from, int to) {
      return static_cast<int>((2ll * u + 1) * to / (2ll * from));
    };
    columns_.resize(static_cast<std::size_t>(color_.width));
    for (int u = 0; u < color_.width; ++u) {
      columns_[static_cast<std::size_t>(u)] = nearest(u, color_.width, raw.width());
    }
    for (int v = 0; v < color_.height; ++v) {
      const std::uint16_t* counts = raw.row(nearest(v, color_.height, raw.height()));
      const float* scale = signal_.z_per_metre().ptr<float>(v);
      float* z = depth_m.row(v);
      for (int u = 0; u < color_.width; ++u) {
        const float metres = signal_.MetresOf(counts[columns_[static_cast<std::size_t>(u)]]) * scale[u];
        z[u] = metres <= max_depth_m_ ? metres : 0.0f;
      }
    }
    return {};
  }

 private:
  const PinholeCamera color_;
  const DepthSignal signal_;
  const float max_depth_m_;
  std::vector<int> columns_;
};

Result<DepthWarp> DepthWarp::Create(const Rig& rig, const DepthWarpConfig& config,
                                    const RenderDevice& device) {
  if (!rig.depth) {
    return Fail(ErrorCode::kInvalidConfig, "cameras.depth is missing in the rig: no depth can be warped");
  }
  if (auto ok = rig.color.Validate(); !ok) {
    return Within("cameras.color", {ErrorCode::kInvalidConfig, ok.error().message});
  }
  if (!(config.near_m >= 0.001 && config.near_m <= 10)) {
    return Fail(ErrorCode::kInvalidConfig, "near_m is outside 0.001..10 m");
  }
  if (!(config.edge_sigmas >= 1 && config.edge_sigmas <= 100)) {
    return Fail(ErrorCode::kInvalidConfig, "edge_sigmas is outside 1..100");
  }
  DepthCamera depth = *rig.depth;
  if (rig.registered) depth.camera = rig.color;  // its pixels' rays, whatever size the picture comes in
  auto signal = DepthSignal::Create(depth, config.max_depth_m);
  if (!signal) return tl::unexpected(signal.error());
  if (rig.registered) {
    return DepthWarp(std::make_unique<RegisteredWay>(rig.color, std::move(*signal), config.max_depth_m));
  }
  if (std::max(rig.color.fx / depth.camera.fx, rig.color.fy / depth.camera.fy) > kMostColorPxPerDepthPx) {
    return Fail(ErrorCode::kInvalidConfig,
                "cameras.depth.fx, fy: a depth pixel would be more than 40 colour pixels wide");
  }
  if (!rig.T_color_depth.matrix().allFinite()) {
    return Fail(ErrorCode::kInvalidConfig, "T_color_depth has a number that is not finite");
  }
  auto way = std::make_unique<MeshWay>(rig, std::move(*signal), config);
  if (auto ok = way->Use(device); !ok) return tl::unexpected(ok.error());
  return DepthWarp(std::move(way));
}

DepthWarp::DepthWarp(std::unique_ptr<Way> way) : way_(std::move(way)) {}
DepthWarp::DepthWarp(DepthWarp&&) noexcept = default;
DepthWarp& DepthWarp::operator=(DepthWarp&&) noexcept = default;
DepthWarp::~DepthWarp() = default;

Status DepthWarp::Run(ImageView<const std::uint16_t> raw, ImageView<const std::uint16_t> amplitude,
                      ImageView<float> depth_m) {
  return way_->Run(raw, amplitude, depth_m);
}

}  // namespace mixstage
