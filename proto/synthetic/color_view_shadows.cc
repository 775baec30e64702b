// SPDX-License-Identifier: Apache-2.0
//
// The figure's shadow on the room: what is left of each lamp's light at nodes of the picture, coarse first.
#include <algorithm>
#include <cstring>

#include "proto/synthetic/color_view.h"

namespace mixstage {
namespace {

// What a shadow takes of a pixel's light: below the first it is left out, above the second it counts in full.
constexpr float kUnseen = 0.012f, kSeen = 0.04f;
constexpr float kCoarseRange = 0.045f;  // shares that differ more within a tile are computed at every node

}  // namespace

void ColorView::MakeNodes(const RoomPlate& plate) {
  const int width = plate.node_point[0].cols;
  const int height = plate.node_point[0].rows;
  coarse_width_ = (width - 1) / kCoarse + 1;
  coarse_height_ = (height - 1) / kCoarse + 1;
  const auto padded = static_cast<std::size_t>((coarse_width_ * coarse_height_ + 15) / 16 * 16);
  coarse_lost_.assign(padded, 0);
  for (int c = 0; c < 3; ++c) {
    node_point_[c] = plate.node_point[c];
    node_normal_[c] = plate.node_normal[c];
    coarse_point_[c].assign(padded, 0);
    coarse_normal_[c].assign(padded, 0);
    coarse_share_[c].assign(padded, 1);
    part_of_light_[c].create(height, width);
    for (int j = 0; j < coarse_height_; ++j) {
      for (int i = 0; i < coarse_width_; ++i) {
        const auto at = static_cast<std::size_t>(j * coarse_width_ + i);
        coarse_point_[c][at] = node_point_[c](j * kCoarse, i * kCoarse);
        coarse_normal_[c][at] = node_normal_[c](j * kCoarse, i * kCoarse);
      }
    }
  }
  for (int j = 0; j < height; ++j) {
    for (int i = 0; i < width; ++i) {
      const int u = std::min(i * kNodeStep, padded_width_ - 1);
      const int v = std::min(j * kNodeStep, padded_height_ - 1);
      const float layers[3] = {plate.window[1](v, u), plate.softbox[1](v, u), plate.rest[1](v, u)};
      const float sum = layers[0] + layers[1] + layers[2] + 1e-6f;
      for (int k = 0; k < 3; ++k) part_of_light_[k](j, i) = layers[k] / sum;
    }
  }
}

float ColorView::Fade(int i, int j, float share[3]) const {
  float lost = 0;
  for (int k = 0; k < 3; ++k) lost += part_of_light_[k](j, i) * (1 - share[k]);
  const float counts = std::clamp((lost - kUnseen) * (1 / (kSeen - kUnseen)), 0.f, 1.f);
  for (int k = 0; k < 3; ++k) share[k] = 1 - counts * (1 - share[k]);
  return counts * lost;
}

cv::Mat1f ColorView::LightLeft(const Figure& figure, const BodyLight& light) {
  CastersOf(figure, casters_);
  FindShadows(light);
  cv::Mat1f left(height_, width_, 1.f);
  for (int v = 0; v < height_; ++v) {
    for (int u = 0; u < width_; ++u) {
      const int i = u / kTile;
      const int j = v / kTile;
      const TileShadow shadow = shadows_[TileIndex(i, j)];
      if (shadow == TileShadow::kNone) continue;
      if (u % kTile == 0) {
        if (shadow == TileShadow::kFine) FineShares(i, j, light);
        if (shadow == TileShadow::kCoarse) CoarseShares(i, j);
      }
      const int node = v % kTile / kNodeStep * kShareStride + u % kTile / kNodeStep;
      const TileData& tile = tile_data_[TileIndex(i, j)];
      constexpr float kLuminance[3] = {0.2126f, 0.7152f, 0.0722f};
      float before = 1e-6f;
      float after = 1e-6f;
      for (int c = 0; c < 3; ++c) {
        for (int k = 0; k < 3; ++k) {
          const float layer = tile.layer[k][c][v % kTile * kTile + u % kTile];
          before += kLuminance[c] * layer;
          after += kLuminance[c] * layer * buffers_->share[k][node];
        }
      }
      left(v, u) = after / before;
    }
  }
  return left;
}

void ColorView::FindShadows(const BodyLight& light) {
  PointSpan span{};
  for (int c = 0; c < 3; ++c) {
    span.p[c] = coarse_point_[c].data();
    span.n[c] = coarse_normal_[c].data();
  }
  span.count = static_cast<int>(coarse_point_[0].size());
  span.window = coarse_share_[0].data();
  span.softbox = coarse_share_[1].data();
  span.ambient = coarse_share_[2].data();
  OccludeRoom(light, casters_.casters.data(), casters_.count, span);
  for (int j = 0; j < coarse_height_; ++j) {
    for (int i = 0; i < coarse_width_; ++i) {
      const auto at = static_cast<std::size_t>(j * coarse_width_ + i);
      float share[3] = {coarse_share_[0][at], coarse_share_[1][at], coarse_share_[2][at]};
      coarse_lost_[at] = Fade(i * kCoarse, j * kCoarse, share);
      for (std::size_t k = 0; k < 3; ++k) coarse_share_[k][at] = share[k];
    }
  }
  constexpr int kPerTile = kTile / kNodeStep / kCoarse;
  for (int j = 0; j < tiles_y_; ++j) {
    for (int i = 0; i < tiles_x_; ++i) {
      float low = 1;
      float high = 0;
      for (int y = 0; y <= kPerTile; ++y) {
        for (int x = 0; x <= kPerTile; ++x) {
          const float lost =
              coarse_lost_[static_cast<std::size_t>((j * kPerTile + y) * coarse_width_ + i * kPerTile + x)];
          low = std::min(low, lost);
          high = std::max(high, lost);
        }
      }
      shadows_[TileIndex(i, j)] = high <= 0                   ? TileShadow::kNone
                                  : high - low > kCoarseRange ? TileShadow::kFine
                                                              : TileShadow::kCoarse;
    }
  }
}

void ColorView::FineShares(int i, int j, const BodyLight& light) {
  Buffers& b = *buffers_;
  const int x0 = i * kTile / kNodeStep;
  const int y0 = j * kTile / kNodeStep;
  for (int c = 0; c < 3; ++c) {
    for (int y = 0; y < kNodes; ++y) {
      std::memcpy(b.node_point[c] + y * kNodes, node_point_[c].ptr<float>(y0 + y) + x0,
                  kNodes * sizeof(float));
      std::memcpy(b.node_normal[c] + y * kNodes, node_normal_[c].ptr<float>(y0 + y) + x0,
                  kNodes * sizeof(float));
    }
    std::fill(b.node_point[c] + kNodes * kNodes, b.node_point[c] + kNodesPadded, 0.f);
    std::fill(b.node_normal[c] + kNodes * kNodes, b.node_normal[c] + kNodesPadded, 0.f);
  }
  PointSpan span{};
  for (int c = 0; c < 3; ++c) {
    span.p[c] = b.node_point[c];
    span.n[c] = b.node_normal[c];
  }
  span.count = kNodesPadded;
  span.window = b.node_share[0];
  span.softbox = b.node_share[1];
  span.ambient = b.node_share[2];
  OccludeRoom(light, casters_.casters.data(), casters_.count, span);
  for (int y = 0; y < kNodes; ++y) {
    for (int x = 0; x < kNodes; ++x) {
      const int at = y * kNodes + x;
      float share[3] = {b.node_share[0][at], b.node_share[1][at], b.node_share[2][at]};
      Fade(x0 + x, y0 + y, share);
      for (int k = 0; k < 3; ++k) b.share[k][y * kShareStride + x] = share[k];
    }
  }
}

void ColorView::CoarseShares(int i, int j) {
  Buffers& b = *buffers_;
  constexpr int kPerTile = kTile / kNodeStep / kCoarse;
  for (int k = 0; k < 3; ++k) {
    auto at = [&](int y, int x) {
      return coarse_share_[k]
                          [static_cast<std::size_t>((j * kPerTile + y) * coarse_width_ + i * kPerTile + x)];
    };
    for (int y = 0; y < kNodes; ++y) {
      const int cy = std::min(y / kCoarse, kPerTile - 1);
      const float fy = static_cast<float>(y - cy * kCoarse) / kCoarse;
      for (int x = 0; x < kNodes; ++x) {
        const int cx = std::min(x / kCoarse, kPerTile - 1);
        const float fx = static_cast<float>(x - cx * kCoarse) / kCoarse;
        const float low = at(cy, cx) + fx * (at(cy, cx + 1) - at(cy, cx));
        const float high = at(cy + 1, cx) + fx * (at(cy + 1, cx + 1) - at(cy + 1, cx));
        b.share[k][y * kShareStride + x] = low + fy * (high - low);
      }
    }
  }
}

}  // namespace mixstage
