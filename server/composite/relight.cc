// SPDX-License-Identifier: Apache-2.0
#include "server/composite/relight.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/base/image_mat.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/composite/relight.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#ifndef MIXSTAGE_RELIGHT_TILE_
#define MIXSTAGE_RELIGHT_TILE_
namespace mixstage {
namespace {

constexpr int kSide = 2 * LightMap::kTile;

// sRGB codes are E = 1.055 L^(1/2.4) - 0.055 but for the darkest ten: light scaled by s gives
// g (E + 0.055) - 0.055 with g = s^(1/2.4), and Y'CbCr is linear in that.
constexpr float kOffset = 0.055f * 255;

// The gains of a square's factors, and of the column and row after it.
struct TileGains {
  static constexpr int kRows = LightMap::kTile + 1;
  static constexpr int kStride = 2 * LightMap::kTile;  // with room for a last vector
  alignas(64) float gains[3][kRows][kStride];

  void Ones() { std::fill_n(&gains[0][0][0], 3 * kRows * kStride, 1.0f); }
};

// What a square is made from and to: the pictures go on to its whole width.
struct RelightTile {
  cv::Rect box;
  const TileGains* room;
  const TileGains* actor;
  ImageView<const std::uint8_t> alpha;
  const YuvImage* color;
  YuvImage* lit;
};

}  // namespace
}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<float, LightMap::kTile>;
using V = hn::Vec<D>;
using D32 = hn::Rebind<std::int32_t, D>;
using DByte = hn::Rebind<std::uint8_t, D>;

HWY_INLINE V Numbers(hn::Vec<DByte> codes) { return hn::ConvertTo(D(), hn::PromoteTo(D32(), codes)); }
HWY_INLINE hn::Vec<DByte> Codes(V value) {
  const D d;
  const V rounded = hn::Clamp(hn::Add(value, hn::Set(d, 0.5f)), hn::Zero(d), hn::Set(d, 255.0f));
  return hn::DemoteTo(DByte(), hn::ConvertTo(D32(), rounded));
}

// Pixels of a row: each lane holds an even one and the odd one after it.
struct Pair {
  V even, odd;
};
HWY_INLINE Pair LoadPair(const std::uint8_t* from) {
  hn::Vec<DByte> even, odd;
  hn::LoadInterleaved2(DByte(), from, even, odd);
  return {Numbers(even), Numbers(odd)};
}
HWY_INLINE void StorePair(const Pair& pair, std::uint8_t* to) {
  hn::StoreInterleaved2(Codes(pair.even), Codes(pair.odd), DByte(), to);
}

// s^(5/12) by t = s^(1/4), s in 0..1: within a seventh of a code, 0 and 1 exact.
HWY_INLINE V CodeGain(V s) {
  const D d;
  const V one = hn::Set(d, 1.0f);
  const V t = hn::Sqrt(hn::Sqrt(hn::Clamp(s, hn::Zero(d), one)));
  V bend = hn::Set(d, 0.40568887f);
  for (const float c : {-0.82732612f, 0.70761077f, -0.93665115f}) bend = hn::MulAdd(bend, t, hn::Set(d, c));
  return hn::Mul(t, hn::MulAdd(hn::Sub(one, t), bend, one));
}

// The gains of the square at a pixel of the full picture; false: all are 1.
bool GainsOf(const cv::Mat3f& factors, const cv::Point& at, TileGains& to) {
  const D d;
  const int left = at.x / 2, columns = std::min(TileGains::kStride, factors.cols - left);
  const V one = hn::Set(d, 1.0f);
  bool any = false;
  std::array<cv::Vec3f, TileGains::kStride> row;
  for (int v = 0; v < TileGains::kRows; ++v) {
    const cv::Vec3f* from = factors[std::min(at.y / 2 + v, factors.rows - 1)] + left;
    if (columns < TileGains::kStride) {  // the last column goes on
      std::fill(std::copy_n(from, columns, row.begin()), row.end(), from[columns - 1]);
      from = row.data();
    }
    for (int u = 0; u < TileGains::kRows; u += static_cast<int>(hn::Lanes(d))) {
      V s[3];
      hn::LoadInterleaved3(d, from[u].val, s[0], s[1], s[2]);
      const auto lit = hn::And(hn::Eq(s[0], one), hn::And(hn::Eq(s[1], one), hn::Eq(s[2], one)));
      if (!hn::AllTrue(d, lit)) {
        any = true;
        for (V& factor : s) factor = CodeGain(factor);
      }
      for (int c = 0; c < 3; ++c) hn::Store(s[c], d, to.gains[c][v] + u);
    }
  }
  return any;
}

// Even pixels have a factor of their own, odd ones lie between two: the same down a column.
HWY_INLINE Pair GainAt(const TileGains& of, int c, int y, int u) {
  const D d;
  const float* above = of.gains[c][y / 2] + u;
  const float* below = of.gains[c][(y + 1) / 2] + u;
  const V half = hn::Set(d, 0.5f);
  const V here = hn::Mul(half, hn::Add(hn::Load(d, above), hn::Load(d, below)));
  const V next = hn::Mul(half, hn::Add(hn::LoadU(d, above + 1), hn::LoadU(d, below + 1)));
  return {here, hn::Mul(half, hn::Add(here, next))};
}

// YcbcrToRgb and RgbToYcbcr (proto/codec/yuv_image.h) with the gains between. luma becomes what it will be,
// blue and red are added to.
HWY_INLINE void Relit(const V (&gain)[3], V cb, V cr, V& luma, V& blue, V& red) {
  const D d;
  const V offset = hn::Set(d, kOffset);
  const V code = hn::Add(luma, offset);
  const V r = hn::Mul(gain[0], hn::MulAdd(hn::Set(d, 1.402f), cr, code));
  const V g = hn::Mul(
      gain[1], hn::NegMulAdd(hn::Set(d, 0.344136f), cb, hn::NegMulAdd(hn::Set(d, 0.714136f), cr, code)));
  const V b = hn::Mul(gain[2], hn::MulAdd(hn::Set(d, 1.772f), cb, code));
  const V scaled =
      hn::MulAdd(hn::Set(d, 0.299f), r, hn::MulAdd(hn::Set(d, 0.587f), g, hn::Mul(hn::Set(d, 0.114f), b)));
  luma = hn::Sub(scaled, offset);
  blue = hn::MulAdd(hn::Set(d, 0.564334f), hn::Sub(b, scaled), blue);
  red = hn::MulAdd(hn::Set(d, 0.713267f), hn::Sub(r, scaled), red);
}

void RelightOne(const RelightTile& in) {
  const D d;
  const cv::Rect& tile = in.box;
  const YuvImage& color = *in.color;
  const int shift_x = ChromaShiftX(color.layout), shift_y = ChromaShiftY(color.layout);
  const V none = hn::Set(d, 128.0f);
  const auto chroma = [&](const cv::Mat1b& plane, int y, int u) HWY_ATTR {
    const std::uint8_t* row = plane[y >> shift_y] + (tile.x >> shift_x);
    Pair codes;
    if (shift_x == 0) {
      codes = LoadPair(row + 2 * u);
    } else {
      codes.even = codes.odd = Numbers(hn::LoadU(DByte(), row + u));
    }
    return Pair{hn::Sub(codes.even, none), hn::Sub(codes.odd, none)};
  };
  // A sample is the mean of its pixels. sum: of rows.
  const auto store = [&](const Pair& sum, int rows, cv::Mat1b& plane, int y, int u) HWY_ATTR {
    std::uint8_t* row = plane[y >> shift_y] + (tile.x >> shift_x);
    const V share = hn::Set(d, 1.0f / static_cast<float>(rows << shift_x));
    if (shift_x == 0) {
      StorePair({hn::MulAdd(share, sum.even, none), hn::MulAdd(share, sum.odd, none)}, row + 2 * u);
    } else {
      hn::StoreU(Codes(hn::MulAdd(share, hn::Add(sum.even, sum.odd), none)), DByte(), row + u);
    }
  };
  for (int y0 = tile.y; y0 < tile.br().y; y0 += 1 << shift_y) {
    const int rows = std::min(1 << shift_y, tile.br().y - y0);
    for (int u = 0; u < LightMap::kTile; u += static_cast<int>(hn::Lanes(d))) {
      const Pair cb = chroma(color.cb, y0, u), cr = chroma(color.cr, y0, u);
      Pair blue = {hn::Zero(d), hn::Zero(d)}, red = blue;
      for (int y = y0; y < y0 + rows; ++y) {
        V even[3], odd[3];
        for (int c = 0; c < 3; ++c) {
          const Pair gain = GainAt(*in.room, c, y - tile.y, u);
          even[c] = gain.even;
          odd[c] = gain.odd;
        }
        if (!in.alpha.empty()) {
          const Pair covered = LoadPair(in.alpha.row(y) + tile.x + 2 * u);
          const V part = hn::Set(d, 1 / 255.0f);
          for (int c = 0; c < 3; ++c) {
            const Pair actor = GainAt(*in.actor, c, y - tile.y, u);
            even[c] = hn::MulAdd(hn::Mul(covered.even, part), hn::Sub(actor.even, even[c]), even[c]);
            odd[c] = hn::MulAdd(hn::Mul(covered.odd, part), hn::Sub(actor.odd, odd[c]), odd[c]);
          }
        }
        Pair luma = LoadPair(color.y[y] + tile.x + 2 * u);
        Relit(even, cb.even, cr.even, luma.even, blue.even, red.even);
        Relit(odd, cb.odd, cr.odd, luma.odd, blue.odd, red.odd);
        StorePair(luma, in.lit->y[y] + tile.x + 2 * u);
      }
      store(blue, rows, in.lit->cb, y0, u);
      store(red, rows, in.lit->cr, y0, u);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(GainsOf);
HWY_EXPORT(RelightOne);

namespace {

// Squares of the full picture, even-aligned.
template <typename Each>
void ForTouched(const LightMap& map, cv::Size size, Each each) {
  for (int v = 0; v < map.touched.rows; ++v) {
    for (int u = 0; u < map.touched.cols; ++u) {
      if (map.touched(v, u) != 0) each(cv::Rect(u * kSide, v * kSide, kSide, kSide) & cv::Rect({}, size));
    }
  }
}

// A factor at a pixel of the full picture: even pixels are the factor's own, odd ones lie between them.
cv::Vec3f FactorAt(const cv::Mat3f& factors, int x, int y) {
  const int left = x / 2, top = y / 2;
  const int right = std::min(left + (x & 1), factors.cols - 1);
  const int below = std::min(top + (y & 1), factors.rows - 1);
  if (right == left && below == top) return factors(top, left);
  if (below == top || right == left) return 0.5f * (factors(top, left) + factors(below, right));
  return 0.25f * (factors(top, left) + factors(top, right) + factors(below, left) + factors(below, right));
}

cv::Vec3f PixelFactor(const LightMap& map, const std::uint8_t* alpha, int x, int y) {
  const std::uint8_t covered = alpha != nullptr ? alpha[x] : 0;
  if (covered == 0) return FactorAt(map.room, x, y);
  const float share = static_cast<float>(covered) * (1 / 255.0f);
  return (1 - share) * FactorAt(map.room, x, y) + share * FactorAt(map.actor, x, y);
}

// A square at the picture's right edge goes on as it ends, beside the picture.
void RelightNarrow(const RelightTile& in) {
  const auto wide = [](const cv::Mat1b& plane, int width) {
    cv::Mat1b whole;
    cv::copyMakeBorder(plane, whole, 0, 0, 0, width - plane.cols, cv::BORDER_REPLICATE | cv::BORDER_ISOLATED);
    return whole;
  };
  const YuvImage from = Crop(*in.color, in.box), to = Crop(*in.lit, in.box);
  const int chroma_width = kSide >> ChromaShiftX(from.layout);
  const YuvImage color = {from.layout, wide(from.y, kSide), wide(from.cb, chroma_width),
                          wide(from.cr, chroma_width)};
  const cv::Mat1b alpha = in.alpha.empty() ? cv::Mat1b() : wide(AsMat(in.alpha)(in.box), kSide);
  YuvImage lit;
  lit.Create(kSide, in.box.height, color.layout);
  HWY_DYNAMIC_DISPATCH(RelightOne)
  ({{0, 0, kSide, in.box.height}, in.room, in.actor, View(alpha), &color, &lit});
  lit.y.colRange(0, to.y.cols).copyTo(to.y);
  lit.cb.colRange(0, to.cb.cols).copyTo(to.cb);
  lit.cr.colRange(0, to.cr.cols).copyTo(to.cr);
}

}  // namespace

void RelightPicture(const LightMap& map, ImageView<const std::uint8_t> alpha, const YuvImage& color,
                    YuvImage& lit) {
  const int w = color.width(), h = color.height();
  lit.Create(w, h, color.layout);
  color.y.copyTo(lit.y);
  color.cb.copyTo(lit.cb);
  color.cr.copyTo(lit.cr);
  TileGains room, actor;
  ForTouched(map, {w, h}, [&](const cv::Rect& tile) {
    const bool room_dims = HWY_DYNAMIC_DISPATCH(GainsOf)(map.room, tile.tl(), room);
    const cv::Rect factors(tile.x / 2, tile.y / 2, TileGains::kRows, TileGains::kRows);
    bool actor_dims = false;
    if (!alpha.empty()) {
      if ((factors & map.actor_bounds).empty()) {
        actor.Ones();
      } else {
        actor_dims = HWY_DYNAMIC_DISPATCH(GainsOf)(map.actor, tile.tl(), actor);
      }
    }
    if (!room_dims && !actor_dims) return;
    const RelightTile square = {tile, &room, &actor, alpha, &color, &lit};
    tile.width == kSide ? HWY_DYNAMIC_DISPATCH(RelightOne)(square) : RelightNarrow(square);
  });
}

void RelightLayer(const LightMap& map, const CgLayer& layer, CgLayer& lit) {
  lit.bounds = layer.bounds;
  lit.depth_m = layer.depth_m;
  lit.object_id = layer.object_id;
  lit.drawing = map.cg_revision;
  lit.color.create(layer.color.size());
  for (int y = 0; y < layer.color.rows; ++y) {
    const cv::Vec4f* from = layer.color[y];
    const cv::Vec3f* factors = map.cg[(layer.bounds.y + y) / 2];
    cv::Vec4f* to = lit.color[y];
    for (int x = 0; x < layer.color.cols; ++x) {
      const float* s = factors[(layer.bounds.x + x) / 2].val;
      const float* color = from[x].val;
      for (int c = 0; c < 3; ++c) to[x].val[c] = color[c] * s[c];
      to[x].val[3] = color[3];
    }
  }
}

cv::Mat3b LightMapPicture(const LightMap& map, ImageView<const std::uint8_t> alpha, cv::Size size, int step) {
  cv::Mat3b picture((size.height + step - 1) / step, (size.width + step - 1) / step, cv::Vec3b::all(255));
  ForTouched(map, size, [&](const cv::Rect& tile) {
    for (int y = tile.y; y < tile.br().y; y += step) {
      for (int x = tile.x; x < tile.br().x; x += step) {
        const cv::Vec3f s = PixelFactor(map, alpha.empty() ? nullptr : alpha.row(y), x, y);
        for (int c = 0; c < 3; ++c)
          picture(y / step, x / step)[2 - c] = cv::saturate_cast<std::uint8_t>(255 * s[c]);
      }
    }
  });
  return picture;
}

cv::Mat3b OnWhite(const cv::Mat3b& light_map) {
  cv::Mat1b codes(1, 256);
  for (int i = 0; i < 256; ++i)
    codes(0, i) = cv::saturate_cast<std::uint8_t>(
        (255 + kOffset) * std::pow(static_cast<float>(i) / 255, 1 / 2.4f) - kOffset);
  cv::Mat3b picture;
  cv::LUT(light_map, codes, picture);
  return picture;
}

}  // namespace mixstage
#endif  // HWY_ONCE
