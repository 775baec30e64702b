// SPDX-License-Identifier: Apache-2.0
#include "server/composite/relight.h"

#include <algorithm>
#include <array>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/composite/relight.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#ifndef MIXSTAGE_RELIGHT_TILE_
#define MIXSTAGE_RELIGHT_TILE_
namespace mixstage {
namespace {

constexpr int kSide = 2 * LightMap::kTile;

// A factor at a pixel of the full picture: even pixels are the factor's own, odd ones lie between them.
cv::Vec3f FactorAt(const cv::Mat3f& factors, int x, int y) {
  const int left = x / 2, top = y / 2;
  const int right = std::min(left + (x & 1), factors.cols - 1);
  const int below = std::min(top + (y & 1), factors.rows - 1);
  if (right == left && below == top) return factors(top, left);
  if (below == top || right == left) return 0.5f * (factors(top, left) + factors(below, right));
  return 0.25f * (factors(top, left) + factors(top, right) + factors(below, left) + factors(below, right));
}

cv::Vec3f PixelFactor(const LightMap& map, const std::uint8_t* alpha, int x, int y) {
  const std::uint8_t covered = alpha != nullptr ? alpha[x] : 0;
  if (covered == 0) return FactorAt(map.room, x, y);
  const float share = static_cast<float>(covered) * (1 / 255.0f);
  return (1 - share) * FactorAt(map.room, x, y) + share * FactorAt(map.actor, x, y);
}

// sRGB codes are E = 1.055 L^(1/2.4) - 0.055 but for the darkest ten: light scaled by s gives
// g (E + 0.055) - 0.055 with g = s^(1/2.4), and Y'CbCr is linear in that.
constexpr float kOffset = 0.055f * 255;
// g by a table of s, s in 0..1.
float CodeGain(float s) {
  constexpr int kSteps = 4096;
  static const auto gains = [] {
    std::array<float, kSteps + 1> table;
    for (std::size_t i = 0; i <= kSteps; ++i) table[i] = std::pow(static_cast<float>(i) / kSteps, 1 / 2.4f);
    return table;
  }();
  return gains[static_cast<std::size_t>(std::clamp(s, 0.0f, 1.0f) * kSteps + 0.5f)];
}

float Code(float value) { return std::min(std::max(value + 0.5f, 0.0f), 255.0f); }

// The gains of a square's factors, and of the column and row after it.
struct TileGains {
  static constexpr int kStride = LightMap::kTile + 1;
  float gains[3][kStride][kStride];
  bool any = false;

  void Ones() {
    any = false;
    std::fill_n(&gains[0][0][0], 3 * kStride * kStride, 1.0f);
  }
  void Of(const cv::Mat3f& factors, const cv::Rect& tile) {
    any = false;
    for (int v = 0; v < kStride; ++v) {
      const cv::Vec3f* row = factors[std::min(tile.y / 2 + v, factors.rows - 1)];
      for (int u = 0; u < kStride; ++u) {
        const cv::Vec3f& s = row[std::min(tile.x / 2 + u, factors.cols - 1)];
        const bool changed = s[0] != 1 || s[1] != 1 || s[2] != 1;
        for (int c = 0; c < 3; ++c) gains[c][v][u] = changed ? CodeGain(s[c]) : 1;
        any = any || changed;
      }
    }
  }
  // FactorAt's mean along a row that counts from the square's top.
  void At(int y, int c, float* out) const {
    const float* above = gains[c][y / 2];
    const float* below = gains[c][y / 2 + (y & 1)];
    float mean[kStride];
    for (int u = 0; u < kStride; ++u) mean[u] = 0.5f * (above[u] + below[u]);
    for (int u = 0; u < LightMap::kTile; ++u) {
      out[2 * u] = mean[u];
      out[2 * u + 1] = 0.5f * (mean[u] + mean[u + 1]);
    }
  }
};

}  // namespace

// What a square is made from and to.
struct RelightTile {
  cv::Rect box;
  const TileGains* room;
  const TileGains* actor;
  ImageView<const std::uint8_t> alpha;
  const YuvImage* color;
  YuvImage* lit;
};

}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

// Plain loops over whole rows of a square: the compiler makes vectors of each target's width of them.
void RelightOne(const RelightTile& in) {
  const cv::Rect& tile = in.box;
  const YuvImage& color = *in.color;
  const int shift_x = ChromaShiftX(color.layout), shift_y = ChromaShiftY(color.layout);
  const int block_w = 1 << shift_x, block_h = 1 << shift_y;
  float gain[3][kSide], actor_gain[3][kSide];
  float luma[kSide] = {}, blue[kSide] = {}, red[kSide] = {}, sum_blue[kSide], sum_red[kSide];
  for (int y0 = tile.y; y0 < tile.br().y; y0 += block_h) {
    const std::uint8_t* cb = color.cb[y0 >> shift_y] + (tile.x >> shift_x);
    const std::uint8_t* cr = color.cr[y0 >> shift_y] + (tile.x >> shift_x);
    for (int x = 0; x < tile.width; ++x) {
      blue[x] = static_cast<float>(cb[x >> shift_x] - 128);
      red[x] = static_cast<float>(cr[x >> shift_x] - 128);
    }
    std::fill_n(sum_blue, kSide, 0.0f);
    std::fill_n(sum_red, kSide, 0.0f);
    const int rows = std::min(block_h, color.height() - y0);
    for (int y = y0; y < y0 + rows; ++y) {
      for (int c = 0; c < 3; ++c) in.room->At(y - tile.y, c, gain[c]);
      if (!in.alpha.empty()) {
        const std::uint8_t* covered = in.alpha.row(y) + tile.x;
        for (int c = 0; c < 3; ++c) {
          in.actor->At(y - tile.y, c, actor_gain[c]);
          for (int x = 0; x < tile.width; ++x)
            gain[c][x] += static_cast<float>(covered[x]) * (1 / 255.0f) * (actor_gain[c][x] - gain[c][x]);
        }
      }
      const std::uint8_t* from = color.y[y] + tile.x;
      for (int x = 0; x < tile.width; ++x) luma[x] = static_cast<float>(from[x]) + kOffset;
      for (int x = 0; x < kSide; ++x) {
        // YcbcrToRgb and RgbToYcbcr (proto/codec/yuv_image.h) with the gains between.
        const float r = gain[0][x] * (luma[x] + 1.402f * red[x]);
        const float g = gain[1][x] * (luma[x] - 0.344136f * blue[x] - 0.714136f * red[x]);
        const float b = gain[2][x] * (luma[x] + 1.772f * blue[x]);
        const float scaled = 0.299f * r + 0.587f * g + 0.114f * b;
        luma[x] = Code(scaled - kOffset);
        sum_blue[x] += 0.564334f * (b - scaled);
        sum_red[x] += 0.713267f * (r - scaled);
      }
      std::uint8_t* to = in.lit->y[y] + tile.x;
      for (int x = 0; x < tile.width; ++x) to[x] = static_cast<std::uint8_t>(luma[x]);
    }
    // A chroma sample is the mean over its luma pixels.
    for (int x0 = 0; x0 < tile.width; x0 += block_w) {
      const int columns = std::min(block_w, tile.width - x0);
      const auto mean = [&](const float* sum) HWY_ATTR {
        const float all = columns == 2 ? sum[x0] + sum[x0 + 1] : sum[x0];
        return static_cast<std::uint8_t>(Code(128 + all / static_cast<float>(columns * rows)));
      };
      in.lit->cb(y0 >> shift_y, (tile.x + x0) >> shift_x) = mean(sum_blue);
      in.lit->cr(y0 >> shift_y, (tile.x + x0) >> shift_x) = mean(sum_red);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(RelightOne);

namespace {

// Squares of the full picture, even-aligned.
template <typename Each>
void ForTouched(const LightMap& map, cv::Size size, Each each) {
  for (int v = 0; v < map.touched.rows; ++v) {
    for (int u = 0; u < map.touched.cols; ++u) {
      if (map.touched(v, u) != 0) each(cv::Rect(u * kSide, v * kSide, kSide, kSide) & cv::Rect({}, size));
    }
  }
}

}  // namespace

void RelightPicture(const LightMap& map, ImageView<const std::uint8_t> alpha, const YuvImage& color,
                    YuvImage& lit) {
  const int w = color.width(), h = color.height();
  lit.Create(w, h, color.layout);
  color.y.copyTo(lit.y);
  color.cb.copyTo(lit.cb);
  color.cr.copyTo(lit.cr);
  TileGains room, actor;
  ForTouched(map, {w, h}, [&](const cv::Rect& tile) {
    room.Of(map.room, tile);
    const cv::Rect factors(tile.x / 2, tile.y / 2, TileGains::kStride, TileGains::kStride);
    (factors & map.actor_bounds).empty() ? actor.Ones() : actor.Of(map.actor, tile);
    if (!room.any && !actor.any) return;
    HWY_DYNAMIC_DISPATCH(RelightOne)({tile, &room, &actor, alpha, &color, &lit});
  });
}

void RelightLayer(const LightMap& map, const CgLayer& layer, CgLayer& lit) {
  lit.bounds = layer.bounds;
  lit.depth_m = layer.depth_m;
  lit.object_id = layer.object_id;
  lit.drawing = map.cg_revision;
  lit.color.create(layer.color.size());
  for (int y = 0; y < layer.color.rows; ++y) {
    const cv::Vec4f* from = layer.color[y];
    const cv::Vec3f* factors = map.cg[(layer.bounds.y + y) / 2];
    cv::Vec4f* to = lit.color[y];
    for (int x = 0; x < layer.color.cols; ++x) {
      const cv::Vec3f& s = factors[(layer.bounds.x + x) / 2];
      to[x] = {from[x][0] * s[0], from[x][1] * s[1], from[x][2] * s[2], from[x][3]};
    }
  }
}

cv::Mat3b LightMapPicture(const LightMap& map, ImageView<const std::uint8_t> alpha, cv::Size size, int step) {
  cv::Mat3b picture((size.height + step - 1) / step, (size.width + step - 1) / step, cv::Vec3b::all(255));
  ForTouched(map, size, [&](const cv::Rect& tile) {
    for (int y = tile.y; y < tile.br().y; y += step) {
      for (int x = tile.x; x < tile.br().x; x += step) {
        const cv::Vec3f s = PixelFactor(map, alpha.empty() ? nullptr : alpha.row(y), x, y);
        for (int c = 0; c < 3; ++c)
          picture(y / step, x / step)[2 - c] = cv::saturate_cast<std::uint8_t>(255 * s[c]);
      }
    }
  });
  return picture;
}

cv::Mat3b OnWhite(const cv::Mat3b& light_map) {
  cv::Mat1b codes(1, 256);
  for (int i = 0; i < 256; ++i)
    codes(0, i) =
        cv::saturate_cast<std::uint8_t>((255 + kOffset) * CodeGain(static_cast<float>(i) / 255) - kOffset);
  cv::Mat3b picture;
  cv::LUT(light_map, codes, picture);
  return picture;
}

}  // namespace mixstage
#endif  // HWY_ONCE
