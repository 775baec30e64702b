// SPDX-License-Identifier: Apache-2.0
#include "server/composite/relight.h"

#include <algorithm>
#include <array>
#include <cmath>

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
float CodeGain(float s) { return std::pow(std::max(s, 0.0f), 1 / 2.4f); }

// The gains of a square's factors and of the column and row after it.
struct TileGains {
  static constexpr int kStride = LightMap::kTile + 1;
  std::array<cv::Vec3f, kStride * kStride> gains;
  std::array<bool, kStride * kStride> changed;
  bool any = false;

  void Of(const cv::Mat3f& factors, const cv::Rect& tile) {
    any = false;
    for (int v = 0; v < kStride; ++v) {
      const cv::Vec3f* row = factors[std::min(tile.y / 2 + v, factors.rows - 1)];
      for (int u = 0; u < kStride; ++u) {
        const auto k = static_cast<std::size_t>(v * kStride + u);
        const cv::Vec3f& s = row[std::min(tile.x / 2 + u, factors.cols - 1)];
        changed[k] = s[0] != 1 || s[1] != 1 || s[2] != 1;
        gains[k] = changed[k] ? cv::Vec3f(CodeGain(s[0]), CodeGain(s[1]), CodeGain(s[2])) : cv::Vec3f::all(1);
        any = any || changed[k];
      }
    }
  }
  // The pixels between the factor (u, v) of the square and the next are all as they are.
  [[nodiscard]] bool StaysAt(int u, int v) const {
    const auto k = static_cast<std::size_t>(v * kStride + u);
    return !(changed[k] || changed[k + 1] || changed[k + kStride] || changed[k + kStride + 1]);
  }
  // FactorAt's mean; x, y count from the square's corner.
  [[nodiscard]] cv::Vec3f At(int x, int y) const {
    const auto top = static_cast<std::size_t>(y / 2 * kStride + x / 2);
    const std::size_t right = (x & 1) != 0 ? 1 : 0, below = (y & 1) != 0 ? kStride : 0;
    if (right + below == 0) return gains[top];
    return 0.25f * (gains[top] + gains[top + right] + gains[top + below] + gains[top + right + below]);
  }
};

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
  const int shift_x = ChromaShiftX(color.layout), shift_y = ChromaShiftY(color.layout);
  const int block_w = 1 << shift_x, block_h = 1 << shift_y;
  TileGains room, actor;
  ForTouched(map, {w, h}, [&](const cv::Rect& tile) {
    room.Of(map.room, tile);
    actor.Of(map.actor, tile);
    if (!room.any && !actor.any) return;
    for (int y0 = tile.y; y0 < tile.br().y; y0 += block_h) {
      for (int x0 = tile.x; x0 < tile.br().x; x0 += block_w) {
        const int u = (x0 - tile.x) / 2, v = (y0 - tile.y) / 2;
        if (room.StaysAt(u, v) && actor.StaysAt(u, v)) continue;
        const auto blue = static_cast<float>(color.cb(y0 >> shift_y, x0 >> shift_x) - 128);
        const auto red = static_cast<float>(color.cr(y0 >> shift_y, x0 >> shift_x) - 128);
        // A chroma sample is the mean over its luma pixels.
        float sum_blue = 0, sum_red = 0;
        int count = 0;
        for (int y = y0; y < std::min(y0 + block_h, h); ++y) {
          const std::uint8_t* covered = alpha.empty() ? nullptr : alpha.row(y);
          for (int x = x0; x < std::min(x0 + block_w, w); ++x, ++count) {
            cv::Vec3f gain = room.At(x - tile.x, y - tile.y);
            if (covered != nullptr && covered[x] != 0)
              gain +=
                  static_cast<float>(covered[x]) * (1 / 255.0f) * (actor.At(x - tile.x, y - tile.y) - gain);
            const float luma = static_cast<float>(color.y(y, x)) + kOffset;
            // YcbcrToRgb and RgbToYcbcr (proto/codec/yuv_image.h) with the gains between.
            const float r = gain[0] * (luma + 1.402f * red);
            const float g = gain[1] * (luma - 0.344136f * blue - 0.714136f * red);
            const float b = gain[2] * (luma + 1.772f * blue);
            const float scaled = 0.299f * r + 0.587f * g + 0.114f * b;
            lit.y(y, x) = static_cast<std::uint8_t>(std::clamp(scaled - kOffset + 0.5f, 0.0f, 255.0f));
            sum_blue += 0.564334f * (b - scaled);
            sum_red += 0.713267f * (r - scaled);
          }
        }
        const auto mean = [&](float sum) {
          return static_cast<std::uint8_t>(
              std::clamp(128.5f + sum / static_cast<float>(count), 0.0f, 255.0f));
        };
        lit.cb(y0 >> shift_y, x0 >> shift_x) = mean(sum_blue);
        lit.cr(y0 >> shift_y, x0 >> shift_x) = mean(sum_red);
      }
    }
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

cv::Mat3b LightMapPicture(const LightMap& map, ImageView<const std::uint8_t> alpha, cv::Size size) {
  cv::Mat3b picture(size, cv::Vec3b::all(255));
  ForTouched(map, size, [&](const cv::Rect& tile) {
    for (int y = tile.y; y < tile.br().y; ++y) {
      for (int x = tile.x; x < tile.br().x; ++x) {
        const cv::Vec3f s = PixelFactor(map, alpha.empty() ? nullptr : alpha.row(y), x, y);
        for (int c = 0; c < 3; ++c) picture(y, x)[2 - c] = cv::saturate_cast<std::uint8_t>(255 * s[c]);
      }
    }
  });
  return picture;
}

}  // namespace mixstage
