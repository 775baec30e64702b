// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/edge_coverage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr int kReach =
    4;  // of the neighbourhood that F and the room's light come from, sampled at every second pixel
constexpr int kLeastSamples = 3;
// |F - B|^2 in units of the noise at which the projection and the evidence weigh the same.
constexpr float kEqualContrast = 100.0f;

std::array<float, 3> PixelAt(const HalfPicture& picture, int x, int y) {
  return {static_cast<float>(picture.r(y, x)), static_cast<float>(picture.g(y, x)),
          static_cast<float>(picture.b(y, x))};
}

std::array<float, 3> RoomAt(const BackgroundModel& model, const ToneChange& tone, int x, int y) {
  std::array<float, 3> room{};
  for (std::size_t c = 0; c < 3; ++c) {
    room[c] = std::clamp(tone.gain[c] * model.mean[c](y, x) + tone.offset[c], 0.0f, 255.0f);
  }
  return room;
}

struct Surroundings {
  std::array<float, 3> F{};
  float light = 1;  // 0.3..1.1: brightness of the room beside, against the empty set
  int inner_count = 0;
};

Surroundings LookAround(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                        const cv::Mat1b& inner, const cv::Mat1b& outer, int x, int y) {
  Surroundings found;
  int now = 0;
  float empty = 0;
  std::array<int, 3> sum{};
  const int left = x < kReach ? x % 2 : x - kReach, right = std::min(x + kReach, inner.cols - 1);
  for (int v = y < kReach ? y % 2 : y - kReach; v <= std::min(y + kReach, inner.rows - 1); v += 2) {
    const std::uint8_t* in = inner.ptr<std::uint8_t>(v);
    const std::uint8_t* out = outer.ptr<std::uint8_t>(v);
    const std::uint8_t* r = picture.r.ptr<std::uint8_t>(v);
    const std::uint8_t* g = picture.g.ptr<std::uint8_t>(v);
    const std::uint8_t* b = picture.b.ptr<std::uint8_t>(v);
    const float* room = model.mean[1].ptr<float>(v);
    for (int u = left; u <= right; u += 2) {
      if (in[u] != 0) {
        sum[0] += r[u];
        sum[1] += g[u];
        sum[2] += b[u];
        ++found.inner_count;
      } else if (out[u] == 0) {
        now += g[u];
        empty += tone.gain[1] * room[u] + tone.offset[1];
      }
    }
  }
  for (std::size_t c = 0; c < 3; ++c) found.F[c] = static_cast<float>(sum[c]);
  for (float& value : found.F) value /= static_cast<float>(std::max(found.inner_count, 1));
  if (empty > 1) found.light = std::clamp(static_cast<float>(now) / empty, 0.3f, 1.1f);
  return found;
}

// C = a F + (1 - a) B solved for a at one pixel, in units of the noise.
void Place(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
           const Surroundings& around, int x, int y, cv::Mat1b* alpha) {
  const auto C = PixelAt(picture, x, y);
  auto B = RoomAt(model, tone, x, y);
  float along = 0, contrast = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    B[c] *= around.light;
    const float inverse = 1 / model.variance[c](y, x);
    along += (C[c] - B[c]) * (around.F[c] - B[c]) * inverse;
    contrast += (around.F[c] - B[c]) * (around.F[c] - B[c]) * inverse;
  }
  const float projected = 255 * std::clamp(along / std::max(contrast, 1e-3f), 0.0f, 1.0f);
  const float trust = contrast / (contrast + kEqualContrast);
  const auto evidence = static_cast<float>((*alpha)(y, x));
  (*alpha)(y, x) = static_cast<std::uint8_t>(evidence + trust * (projected - evidence) + 0.5f);
}

}  // namespace

// Among eight pixels from (x, y) on.
bool EdgeCoverage::HasBand(int x, int y) const {
  std::uint64_t inner = 0, outer = 0;
  std::memcpy(&inner, inner_.ptr<std::uint8_t>(y) + x, sizeof(inner));
  std::memcpy(&outer, outer_.ptr<std::uint8_t>(y) + x, sizeof(outer));
  return inner != outer;
}

void EdgeCoverage::Run(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                       const cv::Mat1b& mask, cv::Mat1b* alpha) {
  MIX_CHECK(alpha != nullptr && mask.size() == picture.r.size() && alpha->size() == mask.size());
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_RECT, {5, 5});
  cv::erode(mask, inner_, kernel);
  cv::dilate(mask, outer_, kernel);
  // Four neighbours share one look around: F and the light change more slowly than the outline.
  for (int y = 0; y < mask.rows; y += 2) {
    const int bottom = std::min(y + 1, mask.rows - 1);
    for (int x = 0; x < mask.cols; x += 2) {
      if (x + 8 <= mask.cols && !HasBand(x, y) && !HasBand(x, bottom)) {
        x += 6;
        continue;
      }
      const int right = std::min(x + 1, mask.cols - 1);
      const auto is_band = [&](int u, int v) {
        return inner_.ptr<std::uint8_t>(v)[u] != outer_.ptr<std::uint8_t>(v)[u];
      };
      if (!is_band(x, y) && !is_band(right, y) && !is_band(x, bottom) && !is_band(right, bottom)) continue;
      const Surroundings around = LookAround(picture, model, tone, inner_, outer_, x, y);
      if (around.inner_count < kLeastSamples) continue;
      for (int v = y; v <= bottom; ++v) {
        for (int u = x; u <= right; ++u) {
          if (is_band(u, v)) Place(picture, model, tone, around, u, v, alpha);
        }
      }
    }
  }
}

}  // namespace mixstage
