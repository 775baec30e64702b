// SPDX-License-Identifier: Apache-2.0
//
// Twin of FindColorEvidenceScalar (color_evidence.cc), which is the specification: same formulas, a vector of
// pixels at a time. The last, partial vector of a row is computed again from its end, rows shorter than a
// vector one by one.
#include <array>
#include <cstdint>

#include "proto/base/check.h"
#include "server/segmentation/color_evidence.h"
#include "server/segmentation/color_evidence_constants.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/color_evidence_simd.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#include "server/segmentation/bytes-inl.h"

#ifndef MIXSTAGE_COLOR_EVIDENCE_ROW_
#define MIXSTAGE_COLOR_EVIDENCE_ROW_
namespace mixstage {

struct ColorRow {
  std::array<const std::uint8_t*, 3> picture;
  std::array<const float*, 3> mean;
  std::array<const float*, 3> variance;
  const float* log_peak_room;
  const float* log_peak_shadow;
  const float* texture;  // already at half resolution
  const std::uint8_t* actor;
  std::uint8_t* room;
  std::uint8_t* shadow;
};

}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class D>
HWY_INLINE void EvidenceAt(D d, const ColorRow& row, std::size_t x, const ToneChange& tone,
                           const ShadowConfig& config) {
  using V = hn::Vec<D>;
  const V one = hn::Set(d, 1.0f);
  const V zero = hn::Zero(d);
  V I_t[3], I_m[3], variance[3];
  hn::Mask<D> above[3];
  V D_t = zero, along = zero, length = zero;
  for (std::size_t c = 0; c < 3; ++c) {
    I_t[c] = LoadByte(d, row.picture[c] + x);
    const V mean = hn::LoadU(d, row.mean[c] + x);
    const float grown = tone.gain[c] > 1 ? tone.gain[c] * tone.gain[c] : 1.0f;
    const V moved_mean = hn::MulAdd(hn::Set(d, tone.gain[c]), mean, hn::Set(d, tone.offset[c]));
    I_m[c] = hn::Min(hn::Max(moved_mean, zero), hn::Set(d, 255.0f));
    const V doubt = hn::Mul(hn::Set(d, kToneDoubt), hn::Sub(I_m[c], mean));
    variance[c] = hn::MulAdd(doubt, doubt, hn::Mul(hn::LoadU(d, row.variance[c] + x), hn::Set(d, grown)));
    above[c] = hn::Gt(mean, hn::Set(d, kClipped));
  }
  // Divisions cost most here: the three inverses come from that of the product.
  const V first = hn::Mul(variance[0], variance[1]);
  const V inverse_product = hn::Div(one, hn::Mul(first, variance[2]));
  const V rest = hn::Mul(inverse_product, variance[2]);
  const V inverses[3] = {hn::Mul(rest, variance[1]), hn::Mul(rest, variance[0]),
                         hn::Mul(inverse_product, first)};
  for (std::size_t c = 0; c < 3; ++c) {
    const V signed_difference = hn::Sub(I_t[c], I_m[c]);
    const V difference = hn::IfThenElse(above[c], hn::Min(signed_difference, zero), signed_difference);
    const V inverse = inverses[c];
    D_t = hn::MulAdd(hn::Mul(difference, difference), inverse, D_t);
    const V weighted = hn::Mul(I_m[c], inverse);
    along = hn::MulAdd(I_t[c], weighted, along);
    length = hn::MulAdd(I_m[c], weighted, length);
  }
  const V farthest = hn::Set(d, kFarthest);
  const V own = LoadLogOdds(d, row.actor + x);
  const V peak = hn::Add(hn::LoadU(d, row.log_peak_room + x), own);
  StoreLogOdds(d, hn::MulAdd(hn::Set(d, kColorTail), hn::Min(D_t, farthest), peak), row.room + x);

  const V s = hn::Div(along, hn::Max(length, hn::Set(d, 1e-3f)));
  const V tolerance = hn::Mul(hn::Set(d, config.chroma_tolerance), hn::Sub(one, s));
  V squared[3], against[3];
  for (std::size_t c = 0; c < 3; ++c) {
    const V allowed = hn::Mul(tolerance, I_m[c]);
    const V difference = hn::NegMulAdd(s, I_m[c], I_t[c]);
    squared[c] = hn::Mul(difference, difference);
    against[c] = hn::MulAdd(allowed, allowed, variance[c]);
  }
  // The sum of three fractions over their common denominator.
  const V both = hn::Mul(against[0], against[1]);
  const V two = hn::MulAdd(squared[0], against[1], hn::Mul(squared[1], against[0]));
  const V chroma = hn::Div(hn::MulAdd(two, against[2], hn::Mul(squared[2], both)), hn::Mul(both, against[2]));
  const V dark =
      hn::Mul(hn::Set(d, config.darkness_cost), hn::Max(hn::Sub(hn::Set(d, config.usual_least), s), zero));
  const V bright = hn::Mul(hn::Set(d, kBrighterCost), hn::Max(hn::Sub(s, hn::Set(d, kBrighter)), zero));
  const V shadow_peak = hn::Add(hn::LoadU(d, row.log_peak_shadow + x), own);
  const V likelihood = hn::MulAdd(hn::Set(d, kShadowTail), hn::Min(chroma, farthest), shadow_peak);
  StoreLogOdds(d, hn::Add(hn::Add(likelihood, hn::Add(dark, bright)), hn::LoadU(d, row.texture + x)),
               row.shadow + x);
}

void EvidenceRow(const ColorRow& row, std::size_t width, const ToneChange& tone, const ShadowConfig& config) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  std::size_t x = 0;
  for (; x + lanes <= width; x += lanes) EvidenceAt(d, row, x, tone, config);
  if (x == width) return;
  if (width >= lanes) {
    EvidenceAt(d, row, width - lanes, tone, config);
  } else {
    for (; x < width; ++x) EvidenceAt(hn::CappedTag<float, 1>(), row, x, tone, config);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(EvidenceRow);

void FindColorEvidence(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                       const ShadowConfig& config, const cv::Mat1f& texture, const cv::Mat1b& actor,
                       ColorEvidence* evidence) {
  MIX_CHECK(evidence != nullptr && model.mean[0].size() == picture.r.size());
  MIX_CHECK(texture.rows == Half(picture.height()) && texture.cols == Half(picture.width()));
  MIX_CHECK(actor.size() == picture.r.size());
  evidence->room.create(picture.height(), picture.width());
  evidence->shadow.create(picture.height(), picture.width());
  const auto width = static_cast<std::size_t>(picture.width());
  cv::AutoBuffer<float, 2048> wide(width + 1);
  for (int y = 0; y < picture.height(); ++y) {
    if (y % 2 == 0) {
      const float* narrow = texture.ptr<float>(y / 2);
      for (std::size_t x = 0; x < width; ++x) wide[x] = narrow[x / 2];
    }
    const ColorRow row = {
        .picture = {picture.r.ptr<std::uint8_t>(y), picture.g.ptr<std::uint8_t>(y),
                    picture.b.ptr<std::uint8_t>(y)},
        .mean = {model.mean[0].ptr<float>(y), model.mean[1].ptr<float>(y), model.mean[2].ptr<float>(y)},
        .variance = {model.variance[0].ptr<float>(y), model.variance[1].ptr<float>(y),
                     model.variance[2].ptr<float>(y)},
        .log_peak_room = model.log_peak_room.ptr<float>(y),
        .log_peak_shadow = model.log_peak_shadow.ptr<float>(y),
        .texture = wide.data(),
        .actor = actor.ptr<std::uint8_t>(y),
        .room = evidence->room.ptr<std::uint8_t>(y),
        .shadow = evidence->shadow.ptr<std::uint8_t>(y)};
    HWY_DYNAMIC_DISPATCH(EvidenceRow)(row, width, tone, config);
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
