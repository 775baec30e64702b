// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/actor_colors.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "proto/base/check.h"
#include "server/segmentation/color_evidence.h"

namespace mixstage {
namespace {

constexpr int kShift = 3;  // bins of 8 levels: several sigmas of a camera, less than two cloths differ by
constexpr std::size_t kBins = 256 >> kShift;
constexpr std::size_t kAllBins = kBins * kBins * kBins;
constexpr float kMostLikely = 4.0f;  // log-odds: he wears little of what the room is not made of too
constexpr float kFade = 0.9f;
constexpr float kOtherColors = 0.15f;  // share of an actor's pixels whose colour was never seen on him
constexpr int kStep = 2;               // every second pixel and row tells the same
constexpr double kLeastPixels = 100;   // sampled; fewer tell nothing about an actor
constexpr int kClearEvidence = kNoEvidence + 32;

std::size_t BinOf(int r, int g, int b) {
  return (static_cast<std::size_t>(r >> kShift) * kBins + static_cast<std::size_t>(g >> kShift)) * kBins +
         static_cast<std::size_t>(b >> kShift);
}

// 1 2 1 along one axis; its ends are repeated.
void SmoothAlong(std::size_t stride, const std::vector<float>& from, std::vector<float>* to) {
  for (std::size_t block = 0; block < kAllBins; block += stride * kBins) {
    for (std::size_t i = 0; i < kBins; ++i) {
      const float* own = from.data() + block + i * stride;
      const float* before = i == 0 ? own : own - stride;
      const float* after = i + 1 == kBins ? own : own + stride;
      float* __restrict out = to->data() + block + i * stride;
      for (std::size_t k = 0; k < stride; ++k) out[k] = 0.25f * (before[k] + after[k]) + 0.5f * own[k];
    }
  }
}

}  // namespace

void ActorColors::Learn(const HalfPicture& picture, const cv::Mat1b& core, const cv::Mat1b& evidence) {
  MIX_CHECK(core.size() == picture.r.size() && evidence.size() == core.size());
  if (counts_.empty()) {
    counts_.assign(kAllBins, 0);
    smooth_.assign(kAllBins, 0);
    scratch_.assign(kAllBins, 0);
  }
  bool fresh = true;
  for (int y = 0; y < core.rows; y += kStep) {
    const std::uint8_t* inside = core.ptr<std::uint8_t>(y);
    const std::uint8_t* sure = evidence.ptr<std::uint8_t>(y);
    const std::uint8_t* r = picture.r.ptr<std::uint8_t>(y);
    const std::uint8_t* g = picture.g.ptr<std::uint8_t>(y);
    const std::uint8_t* b = picture.b.ptr<std::uint8_t>(y);
    for (int x = 0; x < core.cols; x += kStep) {
      if (inside[x] == 0 || sure[x] < kClearEvidence) continue;
      if (fresh) {
        for (float& count : counts_) count *= kFade;
        weight_ *= kFade;
        fresh = false;
      }
      counts_[BinOf(r[x], g[x], b[x])] += 1;
      weight_ += 1;
    }
  }
  if (!fresh && weight_ >= kLeastPixels) Summarise();
}

void ActorColors::Summarise() {
  SmoothAlong(kBins * kBins, counts_, &smooth_);
  SmoothAlong(kBins, smooth_, &scratch_);
  SmoothAlong(1, scratch_, &smooth_);
  likelihood_.resize(kAllBins);
  const auto scale = static_cast<float>((1 - kOtherColors) * kAllBins / weight_);
  const auto to_byte = [](float ratio) {
    return static_cast<std::uint8_t>(std::clamp(
        kNoEvidence + std::min(std::log(ratio), kMostLikely) / kEvidencePerByte + 0.5f, 0.0f, 255.0f));
  };
  const std::uint8_t never = to_byte(kOtherColors);
  for (std::size_t i = 0; i < kAllBins; ++i)
    likelihood_[i] = smooth_[i] > 0 ? to_byte(scale * smooth_[i] + kOtherColors) : never;
}

void ActorColors::Rate(const HalfPicture& picture, cv::Mat1b* likelihood) const {
  likelihood->create(picture.r.size());
  if (likelihood_.empty()) {
    likelihood->setTo(kNoEvidence);
    return;
  }
  for (int y = 0; y < picture.height(); ++y) {
    const std::uint8_t* r = picture.r.ptr<std::uint8_t>(y);
    const std::uint8_t* g = picture.g.ptr<std::uint8_t>(y);
    const std::uint8_t* b = picture.b.ptr<std::uint8_t>(y);
    std::uint8_t* out = likelihood->ptr<std::uint8_t>(y);
    for (int x = 0; x < picture.width(); ++x) out[x] = likelihood_[BinOf(r[x], g[x], b[x])];
  }
}

}  // namespace mixstage
