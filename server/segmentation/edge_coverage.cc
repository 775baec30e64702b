// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/edge_coverage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// Where the actor's own colour and the room's light are looked for, half pixels from the pixel: near samples
// resemble what the pixel shows, far ones are surely one or the other.
struct Offset {
  int x, y;
};
constexpr std::array<Offset, 24> kAround = {{{2, 0},  {-2, 0},  {0, 2},  {0, -2},  {2, 2},  {-2, 2},
                                             {2, -2}, {-2, -2}, {4, 0},  {-4, 0},  {0, 4},  {0, -4},
                                             {3, 3},  {-3, 3},  {3, -3}, {-3, -3}, {6, 1},  {-6, -1},
                                             {-1, 6}, {1, -6},  {5, 4},  {-5, 4},  {5, -4}, {-5, -4}}};
// A cloth's colour differs from one of its pixels to the next by so many levels.
constexpr float kClothSigma = 6.0f;
// What the decision's own coverage is worth beside the colour's residual, in squared sigmas.
constexpr float kDecisionWeight = 6.0f;

using Color = std::array<float, 3>;

struct Surroundings {
  std::array<Color, kAround.size()> F;
  int inner = 0;
  float light = 1;  // 0.3..1.1: brightness of the room beside, against the empty set
};

Surroundings LookAround(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                        const cv::Mat1b& inner, const cv::Mat1b& outer, int x, int y) {
  Surroundings found;
  float now = 0, empty = 0;
  for (const Offset& offset : kAround) {
    const int u = x + offset.x, v = y + offset.y;
    if (u < 0 || v < 0 || u >= inner.cols || v >= inner.rows) continue;
    if (inner.ptr<std::uint8_t>(v)[u] != 0) {
      found.F[static_cast<std::size_t>(found.inner++)] = {
          static_cast<float>(picture.r.ptr<std::uint8_t>(v)[u]),
          static_cast<float>(picture.g.ptr<std::uint8_t>(v)[u]),
          static_cast<float>(picture.b.ptr<std::uint8_t>(v)[u])};
    } else if (outer.ptr<std::uint8_t>(v)[u] == 0) {
      now += static_cast<float>(picture.g.ptr<std::uint8_t>(v)[u]);
      empty += tone.gain[1] * model.mean[1].ptr<float>(v)[u] + tone.offset[1];
    }
  }
  if (empty > 1) found.light = std::clamp(now / empty, 0.3f, 1.1f);
  return found;
}

// C = a F + (1 - a) B solved for a with each F around; the one that explains C best, and the decision nearly
// so well, is taken.
std::uint8_t Place(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                   const Surroundings& around, int x, int y, std::uint8_t decided) {
  const Color C = {static_cast<float>(picture.r.ptr<std::uint8_t>(y)[x]),
                   static_cast<float>(picture.g.ptr<std::uint8_t>(y)[x]),
                   static_cast<float>(picture.b.ptr<std::uint8_t>(y)[x])};
  Color B{}, inverse{};
  for (std::size_t c = 0; c < 3; ++c) {
    B[c] = around.light *
           std::clamp(tone.gain[c] * model.mean[c].ptr<float>(y)[x] + tone.offset[c], 0.0f, 255.0f);
    inverse[c] = 1 / (model.variance[c].ptr<float>(y)[x] + kClothSigma * kClothSigma);
  }
  const float prior = static_cast<float>(decided) / 255;
  float best = std::numeric_limits<float>::max(), alpha = prior;
  for (int i = 0; i < around.inner; ++i) {
    const Color& F = around.F[static_cast<std::size_t>(i)];
    float along = 0, contrast = 0, length = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const float f = F[c] - B[c], d = C[c] - B[c];
      along += d * f * inverse[c];
      contrast += f * f * inverse[c];
      length += d * d * inverse[c];
    }
    const float a = std::clamp((along + kDecisionWeight * prior) / (contrast + kDecisionWeight), 0.0f, 1.0f);
    const float residual = length - 2 * a * along + a * a * contrast;
    const float cost = residual + kDecisionWeight * (a - prior) * (a - prior);
    if (cost < best) best = cost, alpha = a;
  }
  return static_cast<std::uint8_t>(255 * alpha + 0.5f);
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
  for (int y = 0; y < mask.rows; ++y) {
    const std::uint8_t* inner = inner_.ptr<std::uint8_t>(y);
    const std::uint8_t* outer = outer_.ptr<std::uint8_t>(y);
    std::uint8_t* out = alpha->ptr<std::uint8_t>(y);
    for (int x = 0; x < mask.cols; ++x) {
      if (x + 8 <= mask.cols && !HasBand(x, y)) {
        x += 7;
        continue;
      }
      if (inner[x] == outer[x]) continue;
      const Surroundings around = LookAround(picture, model, tone, inner_, outer_, x, y);
      if (around.inner > 0) out[x] = Place(picture, model, tone, around, x, y, out[x]);
    }
  }
}

}  // namespace mixstage
