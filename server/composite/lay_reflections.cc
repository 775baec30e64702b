// SPDX-License-Identifier: Apache-2.0
#include "server/composite/lay_reflections.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "server/composite/mix.h"

namespace mixstage {
namespace {

constexpr float kUnseen = 1e-4f;  // linear light: less than half a grey level even in the dark

float Largest(const cv::Vec3f& v) { return std::max({std::abs(v[0]), std::abs(v[1]), std::abs(v[2])}); }

// A half-size picture at a full-size pixel of its window.
cv::Vec3f Between(const cv::Mat3f& half, int x, int y) {
  const int left = std::max((x - 1) >> 1, 0), top = std::max((y - 1) >> 1, 0);
  const int right = std::min((x + 1) >> 1, half.cols - 1), below = std::min((y + 1) >> 1, half.rows - 1);
  const float to_right = (x & 1) != 0 ? 0.25f : 0.75f, down = (y & 1) != 0 ? 0.25f : 0.75f;
  const cv::Vec3f above = half(top, left) + to_right * (half(top, right) - half(top, left));
  const cv::Vec3f under = half(below, left) + to_right * (half(below, right) - half(below, left));
  return above + down * (under - above);
}

float LeastFactor(const cv::Mat3f& factors, int x, int y) {
  const cv::Vec3f& s = factors(y, x);
  return std::min({s[0], s[1], s[2]});
}

// Half-size pixels of the window where anything may be added to the 2x2 they cover.
cv::Mat1b Live(const MirrorPicture& mirror, const LightMap& map) {
  cv::Mat1b live(mirror.window.size(), std::uint8_t{0});
  for (int y = 0; y < live.rows; ++y) {
    for (int x = 0; x < live.cols; ++x) {
      const int u = mirror.window.x + x, v = mirror.window.y + y;
      float most = mirror.changed.contains({x, y}) ? Largest(mirror.added(y, x)) : 0;
      if (map.touched(v / LightMap::kTile, u / LightMap::kTile) != 0)
        most += (1 - LeastFactor(map.room, u, v)) * Largest(mirror.before(y, x));
      if (most > kUnseen) live(y, x) = 255;
    }
  }
  cv::dilate(live, live, cv::Mat());
  return live;
}

}  // namespace

void ReflectInPicture(const ReflectionPictures& pictures, const LightMap& map,
                      ImageView<const std::uint8_t> alpha, YuvImage& lit) {
  const SrgbTables& srgb = SrgbTables::Get();
  const int shift_x = ChromaShiftX(lit.layout), shift_y = ChromaShiftY(lit.layout);
  for (const MirrorPicture& mirror : pictures.mirrors) {
    if (mirror.patch != 0) continue;
    const cv::Mat1b live = Live(mirror, map);
    for (int v = 0; v < live.rows; ++v) {
      for (int u = 0; u < live.cols; ++u) {
        if (live(v, u) == 0) continue;
        const int x0 = 2 * (mirror.window.x + u), y0 = 2 * (mirror.window.y + v);
        cv::Vec2i chroma_sum[2][2];
        int pixels[2][2] = {};
        bool any = false;
        for (int j = 0; j < 2 && y0 + j < lit.height(); ++j) {
          for (int i = 0; i < 2 && x0 + i < lit.width(); ++i) {
            const int x = x0 + i, y = y0 + j;
            const int cb = lit.cb(y >> shift_y, x >> shift_x), cr = lit.cr(y >> shift_y, x >> shift_x);
            cv::Vec2i& sum = chroma_sum[shift_y != 0 ? 0 : j][shift_x != 0 ? 0 : i];
            ++pixels[shift_y != 0 ? 0 : j][shift_x != 0 ? 0 : i];
            const int seen = alpha.empty() ? 255 : 255 - alpha.row(y)[x];
            if (mirror.surface(2 * v + j, 2 * u + i) == 0 || seen == 0) {
              sum += cv::Vec2i(cb, cr);
              continue;
            }
            const cv::Vec3f before = Between(mirror.before, 2 * u + i, 2 * v + j);
            const cv::Vec3f& s = map.room(y / 2, x / 2);
            cv::Vec3f add = Between(mirror.added, 2 * u + i, 2 * v + j);
            for (int c = 0; c < 3; ++c) add[c] += (1 - s[c]) * before[c];
            add *= static_cast<float>(seen) * (1 / 255.0f);
            if (Largest(add) < kUnseen) {
              sum += cv::Vec2i(cb, cr);
              continue;
            }
            const Rgb8 rgb = FixedYcbcrToRgb(lit.y(y, x), cb, cr);
            const Ycbcr8 out = LinearToYcbcr(srgb, srgb.ToLinear(rgb.r) + add[0],
                                             srgb.ToLinear(rgb.g) + add[1], srgb.ToLinear(rgb.b) + add[2]);
            lit.y(y, x) = out.y;
            sum += cv::Vec2i(out.cb, out.cr);
            any = true;
          }
        }
        if (!any) continue;
        for (int j = 0; j < 2; ++j) {
          for (int i = 0; i < 2; ++i) {
            const int n = pixels[j][i];
            if (n == 0) continue;
            const int x = (x0 + i) >> shift_x, y = (y0 + j) >> shift_y;
            lit.cb(y, x) = static_cast<std::uint8_t>((chroma_sum[j][i][0] + n / 2) / n);
            lit.cr(y, x) = static_cast<std::uint8_t>((chroma_sum[j][i][1] + n / 2) / n);
          }
        }
      }
    }
  }
}

bool ReflectInLayer(const ReflectionPictures& pictures, const CgLayer& layer, CgLayer& reflecting) {
  if (std::ranges::none_of(pictures.mirrors, [](const MirrorPicture& m) { return m.patch != 0; }))
    return false;
  reflecting.bounds = layer.bounds;
  reflecting.depth_m = layer.depth_m;
  reflecting.object_id = layer.object_id;
  layer.color.copyTo(reflecting.color);
  for (const MirrorPicture& mirror : pictures.mirrors) {
    if (mirror.patch == 0) continue;
    const cv::Mat3f mirrored(mirror.added + mirror.before);
    const cv::Rect window(2 * mirror.window.x, 2 * mirror.window.y, 2 * mirror.window.width,
                          2 * mirror.window.height);
    const cv::Rect part = window & layer.bounds;
    for (int y = part.y; y < part.br().y; ++y) {
      const std::uint8_t* ids = layer.object_id[y - layer.bounds.y];
      cv::Vec4f* to = reflecting.color[y - layer.bounds.y];
      for (int x = part.x; x < part.br().x; ++x) {
        const int column = x - layer.bounds.x;
        if (ids[column] != mirror.patch) continue;
        const cv::Vec3f light = Between(mirrored, x - window.x, y - window.y);
        for (int c = 0; c < 3; ++c) to[column][c] += to[column][3] * std::max(0.0f, light[c]);
      }
    }
  }
  return true;
}

}  // namespace mixstage
