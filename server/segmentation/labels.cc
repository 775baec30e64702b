// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/labels.h"

#include "proto/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/labels.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void LabelRow(const std::uint8_t* HWY_RESTRICT alpha, const std::uint8_t* HWY_RESTRICT room, int width,
              std::uint8_t* HWY_RESTRICT label) {
  const hn::ScalableTag<std::uint8_t> d;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto actor = hn::Set(d, std::uint8_t{kLabelActor});
  const auto half = hn::Set(d, std::uint8_t{128});
  const auto choose = [&](hn::Vec<decltype(d)> coverage, hn::Vec<decltype(d)> other) {
    return hn::IfThenElse(hn::Eq(hn::Max(coverage, half), coverage), actor, other);
  };
  int x = 0;
  for (; x + 2 * lanes <= width; x += 2 * lanes) {
    hn::Vec<decltype(d)> even, odd;
    hn::LoadInterleaved2(d, alpha + x, even, odd);
    const auto other = hn::LoadU(d, room + x / 2);
    hn::StoreInterleaved2(choose(even, other), choose(odd, other), d, label + x);
  }
  for (; x < width; ++x) label[x] = alpha[x] >= 128 ? std::uint8_t{kLabelActor} : room[x / 2];
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(LabelRow);

void WriteLabels(ImageView<const std::uint8_t> alpha, const cv::Mat1b& room_label,
                 ImageView<std::uint8_t> label) {
  MIX_CHECK(SameSize(alpha, label));
  MIX_CHECK(room_label.cols == (label.width() + 1) / 2 && room_label.rows == (label.height() + 1) / 2);
  for (int y = 0; y < label.height(); ++y) {
    HWY_DYNAMIC_DISPATCH(LabelRow)
    (alpha.row(y), room_label.ptr<std::uint8_t>(y / 2), label.width(), label.row(y));
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
