// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/depth_evidence_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/depth_evidence_rows.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#include "server/segmentation/bytes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class D, class V = hn::Vec<D>>
HWY_INLINE V Clamp(D d, V value, float low, float high) {
  return hn::Min(hn::Max(value, hn::Set(d, low)), hn::Set(d, high));
}

template <class D>
HWY_INLINE void WeighAt(D d, const DepthRow& row, int x, const DepthEvidenceConfig& config, float* weight,
                        float* weighted) {
  const auto zero = hn::Zero(d);
  const auto D_uv = hn::LoadU(d, row.D + x);
  const auto D_M = hn::LoadU(d, row.D_M + x);
  const auto sigma = hn::Max(hn::LoadU(d, row.sigma + x), hn::Set(d, 1e-4f));
  const auto z = hn::Div(hn::Sub(D_M, D_uv), sigma);
  // Noise against "anywhere between the camera and the room".
  const auto in_front = Clamp(d, z, 0.0f, 14.0f);
  const auto log_odds =
      hn::MulAdd(hn::Mul(in_front, in_front), hn::Set(d, 0.25f), hn::LoadU(d, row.log_peak + x));
  // Eq. (1) is silent on holes: D = 0 would key every hole as an actor.
  const auto known = hn::And(hn::And(hn::Gt(D_uv, zero), hn::Gt(D_M, zero)), hn::Gt(z, hn::Set(d, kBehind)));
  const auto own = hn::IfThenElseZero(known, hn::LoadU(d, row.room_weight + x));
  hn::StoreU(own, d, weight + x);
  hn::StoreU(hn::Mul(own, Clamp(d, log_odds, config.least, config.most)), d, weighted + x);
}

template <class D>
HWY_INLINE void DecideAt(D d, const float* weight, const float* weighted, int x, float* log_odds,
                         std::uint8_t* front, std::uint8_t* room) {
  const auto w = hn::Max(hn::LoadU(d, weight + x), hn::Zero(d));
  const auto mean = hn::Div(hn::LoadU(d, weighted + x), hn::Max(w, hn::Set(d, 0.05f)));
  const auto result = hn::Mul(mean, hn::Min(hn::Mul(w, hn::Set(d, 1 / kMeasured)), hn::Set(d, 1.0f)));
  hn::StoreU(result, d, log_odds + x);
  const auto full = hn::Set(d, 255.0f);
  const auto is_front = hn::IfThenElseZero(hn::Gt(result, hn::Set(d, kFront)), full);
  const auto is_room = hn::IfThenElseZero(hn::Lt(result, hn::Set(d, kRoom)), full);
  StoreByte(d, is_front, front + x);
  StoreByte(d, is_room, room + x);
}

template <class D>
HWY_INLINE void TrustAt(D d, const std::uint8_t* front, const std::uint8_t* room, int x, float edge_weight,
                        float* log_odds, float* inside) {
  const auto in_front = LoadByte(d, front + x), is_room = LoadByte(d, room + x);
  const auto own = hn::LoadU(d, log_odds + x);
  const auto agree = hn::IfThenElse(hn::Gt(own, hn::Zero(d)), in_front, is_room);
  // What is not known may be a gap between his legs: it speaks against "in front", not against "the room".
  const auto asked = hn::IfThenElse(hn::Gt(own, hn::Zero(d)), hn::Set(d, 255.0f), hn::Add(in_front, is_room));
  const auto share = hn::Div(agree, hn::Max(asked, hn::Set(d, 12.0f)));
  const auto scaled =
      hn::Mul(hn::Sub(share, hn::Set(d, kHalfTrust)), hn::Set(d, 1 / (kFullTrust - kHalfTrust)));
  const auto trust = Clamp(d, scaled, 0.0f, 1.0f);
  hn::StoreU(hn::IfThenElseZero(hn::Gt(own, hn::Set(d, kFront)), trust), d, inside + x);
  const auto worth = hn::MulAdd(trust, hn::Set(d, 1 - edge_weight), hn::Set(d, edge_weight));
  hn::StoreU(hn::Mul(own, worth), d, log_odds + x);
}

// Calls step(d, x) for vectors from the left, then for single pixels.
template <class Step>
HWY_INLINE void ForRow(int width, const Step& step) {
  const hn::ScalableTag<float> d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  int x = 0;
  for (; x + lanes <= width; x += lanes) step(d, x);
  for (; x < width; ++x) step(hn::CappedTag<float, 1>(), x);
}

void WeighRow(const DepthRow& row, int width, const DepthEvidenceConfig& config, float* weight,
              float* weighted) {
  ForRow(width, [&](auto d, int x) HWY_ATTR { WeighAt(d, row, x, config, weight, weighted); });
}

void DecideRow(const float* weight, const float* weighted, int width, float* log_odds, std::uint8_t* front,
               std::uint8_t* room) {
  ForRow(width, [&](auto d, int x) HWY_ATTR { DecideAt(d, weight, weighted, x, log_odds, front, room); });
}

void TrustRow(const std::uint8_t* front, const std::uint8_t* room, int width, float edge_weight,
              float* log_odds, float* inside) {
  ForRow(width, [&](auto d, int x) HWY_ATTR { TrustAt(d, front, room, x, edge_weight, log_odds, inside); });
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(WeighRow);
HWY_EXPORT(DecideRow);
HWY_EXPORT(TrustRow);

void WeighDepthRow(const DepthRow& row, int width, const DepthEvidenceConfig& config, float* weight,
                   float* weighted) {
  HWY_DYNAMIC_DISPATCH(WeighRow)(row, width, config, weight, weighted);
}

void DecideDepthRow(const float* weight, const float* weighted, int width, float* log_odds,
                    std::uint8_t* front, std::uint8_t* room) {
  HWY_DYNAMIC_DISPATCH(DecideRow)(weight, weighted, width, log_odds, front, room);
}

void TrustDepthRow(const std::uint8_t* front, const std::uint8_t* room, int width, float edge_weight,
                   float* log_odds, float* inside) {
  HWY_DYNAMIC_DISPATCH(TrustRow)(front, room, width, edge_weight, log_odds, inside);
}

}  // namespace mixstage
#endif  // HWY_ONCE
