// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/shadow_texture.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "server/segmentation/box_mean.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/shadow_texture.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#ifndef MIXSTAGE_SHADOW_TEXTURE_ROW_
#define MIXSTAGE_SHADOW_TEXTURE_ROW_
namespace mixstage {

// Darker against the room is no shadow but him: beside him, as in a gap between his legs, shadow is looked
// for in what is left of the window.
inline constexpr float kDarkestShadow = 0.3f;

struct TextureRow {  // one row at half resolution in, every second pixel out
  const std::uint8_t* r;
  const std::uint8_t* g;
  const std::uint8_t* b;
  const float* room;
  float* count;
  float* now;
  float* own_room;
  float* now_now;
  float* now_room;
  float* room_room;
};

}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Adds a row's lumas and their products, where it may be shadow, to `out` (first = 0) or on top of it (first
// = 1: keep); every second column is enough, since the window that follows covers 6x6 of these pixels and
// neighbours are already means of four samples.
void AddProducts(const TextureRow& row, int width, float gain, float offset, float keep) {
  const hn::ScalableTag<float> d;
  const hn::Rebind<std::int32_t, decltype(d)> d32;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d));
  int x = 0;
  for (; x + lanes <= width / 2; x += lanes) {
    const auto even = [&](const std::uint8_t* plane) {
      hn::Vec<decltype(d8)> first, second;
      hn::LoadInterleaved2(d8, plane + 2 * x, first, second);
      return hn::ConvertTo(d, hn::PromoteTo(d32, first));
    };
    const auto now =
        hn::MulAdd(even(row.r), hn::Set(d, 0.299f),
                   hn::MulAdd(even(row.g), hn::Set(d, 0.587f), hn::Mul(even(row.b), hn::Set(d, 0.114f))));
    hn::Vec<decltype(d)> mean, unused;
    hn::LoadInterleaved2(d, row.room + 2 * x, mean, unused);
    const auto room = hn::MulAdd(mean, hn::Set(d, gain), hn::Set(d, offset));
    const auto kept = hn::Set(d, keep);
    const auto may_be = hn::Gt(now, hn::Mul(hn::Set(d, kDarkestShadow), room));
    const auto some_now = hn::IfThenElseZero(may_be, now), some_room = hn::IfThenElseZero(may_be, room);
    const auto one = hn::IfThenElseZero(may_be, hn::Set(d, 1.0f));
    hn::StoreU(hn::MulAdd(kept, hn::LoadU(d, row.count + x), one), d, row.count + x);
    hn::StoreU(hn::MulAdd(kept, hn::LoadU(d, row.now + x), some_now), d, row.now + x);
    hn::StoreU(hn::MulAdd(kept, hn::LoadU(d, row.own_room + x), some_room), d, row.own_room + x);
    hn::StoreU(hn::MulAdd(now, some_now, hn::Mul(kept, hn::LoadU(d, row.now_now + x))), d, row.now_now + x);
    hn::StoreU(hn::MulAdd(now, some_room, hn::Mul(kept, hn::LoadU(d, row.now_room + x))), d,
               row.now_room + x);
    hn::StoreU(hn::MulAdd(room, some_room, hn::Mul(kept, hn::LoadU(d, row.room_room + x))), d,
               row.room_room + x);
  }
  for (; x < (width + 1) / 2; ++x) {
    const float now = 0.299f * row.r[2 * x] + 0.587f * row.g[2 * x] + 0.114f * row.b[2 * x];
    const float room = row.room[2 * x] * gain + offset;
    const float one = now > kDarkestShadow * room ? 1.0f : 0.0f;
    row.count[x] = row.count[x] * keep + one;
    row.now[x] = row.now[x] * keep + one * now;
    row.own_room[x] = row.own_room[x] * keep + one * room;
    row.now_now[x] = row.now_now[x] * keep + one * now * now;
    row.now_room[x] = row.now_room[x] * keep + one * now * room;
    row.room_room[x] = row.room_room[x] * keep + one * room * room;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(AddProducts);

namespace {

// Contrast kept, as shares of the brightness kept.
constexpr float kLeastContrast = 0.3f, kMostContrast = 1.5f;
// Pixels' sums in a window's mean, of two, from which it tells something.
constexpr float kFewest = 0.7f;

}  // namespace

void ShadowTexture::Run(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                        cv::Mat1f* texture, cv::Mat1f* kept) {
  const int rows = Half(picture.height());
  const int columns = Half(picture.width());
  for (cv::Mat1f* plane : {&count_, &now_, &room_, &now_now_, &now_room_, &room_room_}) {
    if (plane->rows == rows && plane->cols == columns) continue;
    plane->create(rows, columns);
    plane->setTo(0);
  }
  texture->create(rows, columns);
  for (int y = 0; y < rows; ++y) {
    for (int k = 0; k < 2; ++k) {
      const int from = std::min(2 * y + k, picture.height() - 1);
      const TextureRow row = {picture.r.ptr<std::uint8_t>(from),
                              picture.g.ptr<std::uint8_t>(from),
                              picture.b.ptr<std::uint8_t>(from),
                              model.mean_luma.ptr<float>(from),
                              count_.ptr<float>(y),
                              now_.ptr<float>(y),
                              room_.ptr<float>(y),
                              now_now_.ptr<float>(y),
                              now_room_.ptr<float>(y),
                              room_room_.ptr<float>(y)};
      // The last pair of an odd row is one pixel; it is read where it is.
      HWY_DYNAMIC_DISPATCH(AddProducts)
      (row, picture.width(), tone.luma_gain(), tone.luma_offset(), static_cast<float>(k));
    }
  }
  for (cv::Mat1f* plane : {&count_, &now_, &room_, &now_now_, &now_room_, &room_room_}) MeanOf3x3(plane);
  for (int y = 0; y < rows; ++y) {
    const float* now_now = now_now_.ptr<float>(y);
    const float* now_room = now_room_.ptr<float>(y);
    const float* room_room = room_room_.ptr<float>(y);
    const float* noise = model.texture_noise.ptr<float>(y);
    const float* count = count_.ptr<float>(y);
    float* __restrict out = texture->ptr<float>(y);
    for (int x = 0; x < columns; ++x) {
      const float s = now_room[x] / std::max(room_room[x], 1.0f);
      const float residual = std::max(now_now[x] - s * now_room[x], 0.0f);
      // JPEG and penumbrae add a few per cent of the texture's own contrast. Noise is that of two pixels'
      // sum.
      const float share = 0.5f * std::max(count[x], kFewest);
      const float expected = share * (noise[x] + 2.0f) + 0.0036f * s * s * room_room[x];
      out[x] = 0.8f * std::clamp(residual / expected - 1.0f, 0.0f, 6.0f);
    }
  }
  // Of the windows that hold a pixel the one that the shadow explains best: others reach across the actor's
  // outline.
  cv::erode(*texture, *texture, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  Compare(model, kept);
}

// The picture's luma as a line of the room's, over a wider window: what the line explains beside what it
// leaves.
void ShadowTexture::Compare(const BackgroundModel& model, cv::Mat1f* kept) {
  for (cv::Mat1f* plane : {&count_, &now_, &room_, &now_now_, &now_room_, &room_room_}) MeanOf3x3(plane);
  kept->create(now_.size());
  for (int y = 0; y < now_.rows; ++y) {
    const float* now = now_.ptr<float>(y);
    const float* room = room_.ptr<float>(y);
    const float* now_now = now_now_.ptr<float>(y);
    const float* now_room = now_room_.ptr<float>(y);
    const float* room_room = room_room_.ptr<float>(y);
    const float* noise = model.texture_noise.ptr<float>(y);
    const float* count = count_.ptr<float>(y);
    float* __restrict out = kept->ptr<float>(y);
    for (int x = 0; x < now_.cols; ++x) {
      // All times the square of the count.
      const float n = count[x];
      const float common = n * now_room[x] - now[x] * room[x];
      const float room_variance = std::max(n * room_room[x] - room[x] * room[x], 4e-3f);
      const float now_variance = n * now_now[x] - now[x] * now[x];
      const float slope = common / room_variance;
      const float explained = slope * common;
      const float left = std::max(now_variance - explained, 0.0f) + n * n * (0.5f * noise[x] + 1.0f);
      // Light scales brightness and contrast alike; a reflection adds some of the one.
      const float contrast = slope * room[x];
      const bool alike =
          (contrast > kLeastContrast * now[x]) & (contrast < kMostContrast * now[x]) & (n > kFewest);
      out[x] = alike ? explained / left : 0.0f;
    }
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
