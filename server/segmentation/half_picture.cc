// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/half_picture.h"

#include <algorithm>
#include <cstdint>

#include "proto/base/check.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/half_picture.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// out[x] = rounded mean of the 2x2 block at 2x; both rows are `width` long, the last column of an odd row
// counts twice.
void PoolRows(const std::uint8_t* HWY_RESTRICT top, const std::uint8_t* HWY_RESTRICT bottom, int width,
              std::uint8_t* HWY_RESTRICT out) {
  const hn::ScalableTag<std::int16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  int x = 0;
  for (; x + lanes <= width / 2; x += lanes) {
    hn::Vec<decltype(d8)> a, b, c, d;
    hn::LoadInterleaved2(d8, top + 2 * x, a, b);
    hn::LoadInterleaved2(d8, bottom + 2 * x, c, d);
    const auto sum = hn::Add(hn::Add(hn::PromoteTo(d16, a), hn::PromoteTo(d16, b)),
                             hn::Add(hn::PromoteTo(d16, c), hn::PromoteTo(d16, d)));
    hn::StoreU(hn::DemoteTo(d8, hn::ShiftRight<2>(hn::Add(sum, hn::Set(d16, 2)))), d8, out + x);
  }
  for (; x < Half(width); ++x) {
    const int right = std::min(2 * x + 1, width - 1);
    out[x] = static_cast<std::uint8_t>((top[2 * x] + top[right] + bottom[2 * x] + bottom[right] + 2) / 4);
  }
}

void AverageRows(const std::uint8_t* HWY_RESTRICT top, const std::uint8_t* HWY_RESTRICT bottom, int width,
                 std::uint8_t* HWY_RESTRICT out) {
  for (int x = 0; x < width; ++x) out[x] = static_cast<std::uint8_t>((top[x] + bottom[x] + 1) / 2);
}

// JFIF with factors in 1/256; chroma is raised by 7 bits so that one rounding high multiply gives whole
// levels.
void ConvertRow(const std::uint8_t* HWY_RESTRICT luma, const std::uint8_t* HWY_RESTRICT cb,
                const std::uint8_t* HWY_RESTRICT cr, int width, std::uint8_t* HWY_RESTRICT r,
                std::uint8_t* HWY_RESTRICT g, std::uint8_t* HWY_RESTRICT b) {
  const hn::ScalableTag<std::int16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto bias = hn::Set(d16, 128);
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    const auto y = hn::PromoteTo(d16, hn::LoadU(d8, luma + x));
    const auto u = hn::ShiftLeft<7>(hn::Sub(hn::PromoteTo(d16, hn::LoadU(d8, cb + x)), bias));
    const auto v = hn::ShiftLeft<7>(hn::Sub(hn::PromoteTo(d16, hn::LoadU(d8, cr + x)), bias));
    const auto red = hn::Add(y, hn::MulFixedPoint15(v, hn::Set(d16, 359)));
    const auto green = hn::Sub(
        y, hn::Add(hn::MulFixedPoint15(u, hn::Set(d16, 88)), hn::MulFixedPoint15(v, hn::Set(d16, 183))));
    const auto blue = hn::Add(y, hn::MulFixedPoint15(u, hn::Set(d16, 454)));
    hn::StoreU(hn::DemoteTo(d8, red), d8, r + x);
    hn::StoreU(hn::DemoteTo(d8, green), d8, g + x);
    hn::StoreU(hn::DemoteTo(d8, blue), d8, b + x);
  }
  const auto clamp = [](int value) { return static_cast<std::uint8_t>(std::clamp(value, 0, 255)); };
  const auto scale = [](int chroma, int factor) { return (chroma * factor + 128) >> 8; };
  for (; x < width; ++x) {
    const int u = cb[x] - 128;
    const int v = cr[x] - 128;
    r[x] = clamp(luma[x] + scale(v, 359));
    g[x] = clamp(luma[x] - scale(u, 88) - scale(v, 183));
    b[x] = clamp(luma[x] + scale(u, 454));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {
namespace {

HWY_EXPORT(PoolRows);
HWY_EXPORT(AverageRows);
HWY_EXPORT(ConvertRow);

// Chroma row y of the half picture; `scratch` is used where the layout is not half size already.
const std::uint8_t* HalfChromaRow(const cv::Mat1b& plane, ChromaLayout layout, int y, std::uint8_t* scratch) {
  if (layout == ChromaLayout::k420) return plane.ptr<std::uint8_t>(y);
  const std::uint8_t* top = plane.ptr<std::uint8_t>(2 * y);
  const std::uint8_t* bottom = plane.ptr<std::uint8_t>(std::min(2 * y + 1, plane.rows - 1));
  if (layout == ChromaLayout::k422) {
    HWY_DYNAMIC_DISPATCH(AverageRows)(top, bottom, plane.cols, scratch);
  } else {
    HWY_DYNAMIC_DISPATCH(PoolRows)(top, bottom, plane.cols, scratch);
  }
  return scratch;
}

}  // namespace

void HalfRgb(const YuvImage& image, HalfPicture* half) {
  MIX_CHECK(half != nullptr && !image.empty());
  const int width = Half(image.width());
  const int height = Half(image.height());
  half->r.create(height, width);
  half->g.create(height, width);
  half->b.create(height, width);
  cv::AutoBuffer<std::uint8_t, 3 * 2048> rows(static_cast<std::size_t>(3 * width));
  std::uint8_t* luma = rows.data();
  for (int y = 0; y < height; ++y) {
    const std::uint8_t* bottom = image.y.ptr<std::uint8_t>(std::min(2 * y + 1, image.height() - 1));
    HWY_DYNAMIC_DISPATCH(PoolRows)(image.y.ptr<std::uint8_t>(2 * y), bottom, image.width(), luma);
    const std::uint8_t* cb = HalfChromaRow(image.cb, image.layout, y, luma + width);
    const std::uint8_t* cr = HalfChromaRow(image.cr, image.layout, y, luma + 2 * width);
    HWY_DYNAMIC_DISPATCH(ConvertRow)
    (luma, cb, cr, width, half->r.ptr<std::uint8_t>(y), half->g.ptr<std::uint8_t>(y),
     half->b.ptr<std::uint8_t>(y));
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
