// SPDX-License-Identifier: Apache-2.0
//
// Pixels and evidence are bytes, what is reckoned with them are floats: the way there and back for the vector
// kernels, compiled once per instruction set. Include after hwy/highway.h, inside no namespace.
#if defined(MIXSTAGE_SERVER_SEGMENTATION_BYTES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef MIXSTAGE_SERVER_SEGMENTATION_BYTES_INL_H_
#undef MIXSTAGE_SERVER_SEGMENTATION_BYTES_INL_H_
#else
#define MIXSTAGE_SERVER_SEGMENTATION_BYTES_INL_H_
#endif

#include <hwy/highway.h>

#include <cstdint>

#include "server/segmentation/color_evidence.h"

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class D, class V = hn::Vec<D>>
HWY_INLINE V LoadByte(D d, const std::uint8_t* from) {
  const hn::Rebind<std::uint8_t, D> d8;
  const hn::Rebind<std::int32_t, D> d32;
  return hn::ConvertTo(d, hn::PromoteTo(d32, hn::LoadU(d8, from)));
}

// Limited to 0..255, cut off after the point.
template <class D, class V = hn::Vec<D>>
HWY_INLINE void StoreByte(D d, V value, std::uint8_t* to) {
  const hn::Rebind<std::uint8_t, D> d8;
  const hn::Rebind<std::int32_t, D> d32;
  const auto limited = hn::Min(hn::Max(value, hn::Zero(d)), hn::Set(d, 255.0f));
  hn::StoreU(hn::DemoteTo(d8, hn::ConvertTo(d32, limited)), d8, to);
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE V LoadLogOdds(D d, const std::uint8_t* from) {
  return hn::Mul(hn::Sub(LoadByte(d, from), hn::Set(d, kNoEvidence)), hn::Set(d, kEvidencePerByte));
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE void StoreLogOdds(D d, V log_odds, std::uint8_t* to) {
  StoreByte(d, hn::MulAdd(log_odds, hn::Set(d, 1 / kEvidencePerByte), hn::Set(d, kNoEvidence + 0.5f)), to);
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#endif  // MIXSTAGE_SERVER_SEGMENTATION_BYTES_INL_H_
