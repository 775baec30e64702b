// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/box_mean.h"

#include <algorithm>
#include <cstddef>
#include <cstring>

#include "proto/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/box_mean.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// row_sum[x] = sum of padded[x .. x + taps); sum[x] gains it and loses what row_sum held before.
void SumRow(const std::uint8_t* HWY_RESTRICT padded, int width, int taps, std::uint16_t* HWY_RESTRICT row_sum,
            std::uint16_t* HWY_RESTRICT sum) {
  const hn::ScalableTag<std::uint16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    auto own = hn::PromoteTo(d16, hn::LoadU(d8, padded + x));
    for (int k = 1; k < taps; ++k) own = hn::Add(own, hn::PromoteTo(d16, hn::LoadU(d8, padded + x + k)));
    hn::StoreU(hn::Add(hn::LoadU(d16, sum + x), hn::Sub(own, hn::LoadU(d16, row_sum + x))), d16, sum + x);
    hn::StoreU(own, d16, row_sum + x);
  }
  for (; x < width; ++x) {
    int own = 0;
    for (int k = 0; k < taps; ++k) own += padded[x + k];
    sum[x] = static_cast<std::uint16_t>(sum[x] + own - row_sum[x]);
    row_sum[x] = static_cast<std::uint16_t>(own);
  }
}

// Division by the area, rounded: (sum + area / 2) times factor, of which the upper 16 bit count.
void DivideRow(const std::uint16_t* HWY_RESTRICT sum, int width, int area, int factor,
               std::uint8_t* HWY_RESTRICT out) {
  const hn::ScalableTag<std::uint16_t> d16;
  const hn::Rebind<std::int16_t, decltype(d16)> d16s;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto half = hn::Set(d16, static_cast<std::uint16_t>(area / 2));
  const auto by = hn::Set(d16, static_cast<std::uint16_t>(factor));
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    const auto mean = hn::MulHigh(hn::Add(hn::LoadU(d16, sum + x), half), by);
    hn::StoreU(hn::DemoteTo(d8, hn::BitCast(d16s, mean)), d8, out + x);
  }
  for (; x < width; ++x) out[x] = static_cast<std::uint8_t>(((sum[x] + area / 2) * factor) >> 16);
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(SumRow);
HWY_EXPORT(DivideRow);

BoxMean::BoxMean(int reach) : reach_(reach) { MIX_CHECK(reach >= 1 && reach <= 7); }

void BoxMean::Run(const cv::Mat1b& from, cv::Mat1b* to) {
  MIX_CHECK(to != nullptr && !from.empty() && to->data != from.data);
  to->create(from.size());
  const int taps = 2 * reach_ + 1;
  const int area = taps * taps;
  // The least factor that is not below 1 / area: whole means come out whole, for sums of up to 225 bytes exactly.
  const int factor = (65536 + area - 1) / area;
  const auto width = static_cast<std::size_t>(from.cols);
  const auto reach = static_cast<std::size_t>(reach_);
  padded_.resize(width + 2 * reach);
  row_sums_.assign(width * static_cast<std::size_t>(taps), 0);
  sums_.assign(width, 0);
  for (int v = -reach_; v < from.rows + reach_; ++v) {
    const std::uint8_t* row = from.ptr<std::uint8_t>(std::clamp(v, 0, from.rows - 1));
    std::memset(padded_.data(), row[0], reach);
    std::memcpy(padded_.data() + reach, row, width);
    std::memset(padded_.data() + reach + width, row[width - 1], reach);
    std::uint16_t* row_sum = row_sums_.data() + width * static_cast<std::size_t>((v + reach_) % taps);
    HWY_DYNAMIC_DISPATCH(SumRow)(padded_.data(), from.cols, taps, row_sum, sums_.data());
    if (v < reach_) continue;
    HWY_DYNAMIC_DISPATCH(DivideRow)(sums_.data(), from.cols, area, factor, to->ptr<std::uint8_t>(v - reach_));
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
