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

// out[x] = (sum[x] + area / 2) / area.
void DivideRow(const std::uint16_t* HWY_RESTRICT sum, int width, int area, std::uint8_t* HWY_RESTRICT out) {
  // As a product with the largest 16-bit factor 2^(16 + shift) / area, rounded up: exact for sums of bytes.
  int shift = 0;
  while (((2 << (16 + shift)) + area - 1) / area < 65536) ++shift;
  const int factor = ((1 << (16 + shift)) + area - 1) / area;
  const hn::ScalableTag<std::uint16_t> d16;
  const hn::Rebind<std::int16_t, decltype(d16)> d16s;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto half = hn::Set(d16, static_cast<std::uint16_t>(area / 2));
  const auto by = hn::Set(d16, static_cast<std::uint16_t>(factor));
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    const auto mean = hn::ShiftRightSame(hn::MulHigh(hn::Add(hn::LoadU(d16, sum + x), half), by), shift);
    hn::StoreU(hn::DemoteTo(d8, hn::BitCast(d16s, mean)), d8, out + x);
  }
  for (; x < width; ++x) out[x] = static_cast<std::uint8_t>((sum[x] + area / 2) / area);
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
    HWY_DYNAMIC_DISPATCH(DivideRow)(sums_.data(), from.cols, area, to->ptr<std::uint8_t>(v - reach_));
  }
}

void MeanOf3x3(cv::Mat1f* plane) {
  MIX_CHECK(plane != nullptr && !plane->empty());
  const int width = plane->cols;
  const auto stride = static_cast<std::size_t>(width);
  // Sums of three in a row, of the row above, this one and the one below; a row is overwritten once both are
  // known.
  cv::AutoBuffer<float, 3 * 1024> rows(3 * stride);
  const auto sum_row = [&](int y) {
    const float* from = plane->ptr<float>(y);
    float* __restrict to = rows.data() + stride * static_cast<std::size_t>(y % 3);
    for (int x = 1; x + 1 < width; ++x) to[x] = from[x - 1] + from[x] + from[x + 1];
    to[0] = 2 * from[0] + from[std::min(1, width - 1)];
    if (width > 1) to[width - 1] = from[width - 2] + 2 * from[width - 1];
  };
  sum_row(0);
  for (int y = 0; y < plane->rows; ++y) {
    if (y + 1 < plane->rows) sum_row(y + 1);
    const float* above = rows.data() + stride * static_cast<std::size_t>(std::max(y - 1, 0) % 3);
    const float* own = rows.data() + stride * static_cast<std::size_t>(y % 3);
    const float* below =
        rows.data() + stride * static_cast<std::size_t>(std::min(y + 1, plane->rows - 1) % 3);
    float* __restrict out = plane->ptr<float>(y);
    for (int x = 0; x < width; ++x) out[x] = (above[x] + own[x] + below[x]) * (1.0f / 9);
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
