// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/enlarge.h"

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "proto/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/enlarge.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// mixed[x + 1] = 3 near[x] + far[x], with the border repeated at mixed[0] and mixed[width + 1].
void MixRows(const std::uint8_t* HWY_RESTRICT near, const std::uint8_t* HWY_RESTRICT far, int width,
             std::int16_t* HWY_RESTRICT mixed) {
  const hn::ScalableTag<std::int16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    const auto a = hn::PromoteTo(d16, hn::LoadU(d8, near + x));
    const auto b = hn::PromoteTo(d16, hn::LoadU(d8, far + x));
    hn::StoreU(hn::Add(hn::Add(a, b), hn::ShiftLeft<1>(a)), d16, mixed + x + 1);
  }
  for (; x < width; ++x) mixed[x + 1] = static_cast<std::int16_t>(3 * near[x] + far[x]);
  mixed[0] = mixed[1];
  mixed[width + 1] = mixed[width];
}

// out[2x], out[2x + 1] from mixed[x .. x + 2], rounded from sixteenths.
void SpreadRow(const std::int16_t* HWY_RESTRICT mixed, int width, std::uint8_t* HWY_RESTRICT out) {
  const hn::ScalableTag<std::int16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto round = hn::Set(d16, 8);
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    const auto left = hn::LoadU(d16, mixed + x);
    const auto here = hn::LoadU(d16, mixed + x + 1);
    const auto right = hn::LoadU(d16, mixed + x + 2);
    const auto triple = hn::Add(hn::Add(here, hn::ShiftLeft<1>(here)), round);
    const auto even = hn::DemoteTo(d8, hn::ShiftRight<4>(hn::Add(triple, left)));
    const auto odd = hn::DemoteTo(d8, hn::ShiftRight<4>(hn::Add(triple, right)));
    hn::StoreInterleaved2(even, odd, d8, out + 2 * x);
  }
  for (; x < width; ++x) {
    out[2 * x] = static_cast<std::uint8_t>((3 * mixed[x + 1] + mixed[x] + 8) >> 4);
    out[2 * x + 1] = static_cast<std::uint8_t>((3 * mixed[x + 1] + mixed[x + 2] + 8) >> 4);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(MixRows);
HWY_EXPORT(SpreadRow);

void EnlargeTwice(const cv::Mat1b& from, ImageView<std::uint8_t> to) {
  MIX_CHECK(to.width() <= 2 * from.cols && to.width() >= 2 * from.cols - 1);
  MIX_CHECK(to.height() <= 2 * from.rows && to.height() >= 2 * from.rows - 1);
  cv::AutoBuffer<std::int16_t, 2048> mixed(static_cast<std::size_t>(from.cols + 2));
  cv::AutoBuffer<std::uint8_t, 4096> whole(static_cast<std::size_t>(2 * from.cols));
  for (int y = 0; y < to.height(); ++y) {
    const int near = y / 2;
    const int far = std::clamp(y % 2 == 0 ? near - 1 : near + 1, 0, from.rows - 1);
    HWY_DYNAMIC_DISPATCH(MixRows)
    (from.ptr<std::uint8_t>(near), from.ptr<std::uint8_t>(far), from.cols, mixed.data());
    if (to.width() == 2 * from.cols) {
      HWY_DYNAMIC_DISPATCH(SpreadRow)(mixed.data(), from.cols, to.row(y));
    } else {
      HWY_DYNAMIC_DISPATCH(SpreadRow)(mixed.data(), from.cols, whole.data());
      std::memcpy(to.row(y), whole.data(), static_cast<std::size_t>(to.width()));
    }
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
