// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/edge_coverage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <opencv2/imgproc.hpp>

#include "proto/base/check.h"
#include "proto/base/image_mat.h"
#include "server/segmentation/enlarge.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/edge_coverage.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#ifndef MIXSTAGE_EDGE_COVERAGE_BLOCK_
#define MIXSTAGE_EDGE_COVERAGE_BLOCK_
namespace mixstage {

// Where the actor's own colour and the room's light are looked for, half pixels from the pixel: near samples
// resemble what the pixel shows, far ones are surely one or the other.
struct Offset {
  int x, y;
};
inline constexpr std::array<Offset, 16> kAround = {{{2, 0},
                                                    {-2, 0},
                                                    {0, 2},
                                                    {0, -2},
                                                    {2, 2},
                                                    {-2, 2},
                                                    {2, -2},
                                                    {-2, -2},
                                                    {4, 0},
                                                    {-4, 0},
                                                    {0, 4},
                                                    {0, -4},
                                                    {4, 3},
                                                    {-4, 3},
                                                    {4, -3},
                                                    {-4, -3}}};
// A cloth's colour differs from one of its pixels to the next by so many levels.
inline constexpr float kClothSigma = 6.0f;
// What the decision's own coverage is worth beside the colour's residual, in squared sigmas.
inline constexpr float kDecisionWeight = 18.0f;
// The same between one F and another: any mixture can be explained by some F and its own a.
inline constexpr float kChoiceWeight = 60.0f;
// Square root of three: most of the noise is luma's, which three channels show but one time.
inline constexpr float kOneOfThree = 1.732f;

inline constexpr std::array<float, 3> kLuma = {0.299f, 0.587f, 0.114f};

using Color = std::array<float, 3>;  // R, G, B

// Four pixels of the picture that are one at half size: they have its colour and their own luma.
struct Block {
  Color C, B, variance;                   // of half size
  std::array<float, 4> luma_C, luma_B;    // what each pixel is brighter than that
  std::array<float, 4> prior;             // 0..1
  std::array<Color, kAround.size()> F{};  // candidates
  int candidates = 0;
};
struct BlockMatte {
  std::array<float, 4> alpha;               // 0..1
  std::array<std::array<float, 4>, 3> F{};  // R, G, B
};

}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// C = a F + (1 - a) B solved for a with each F around; the one that explains C best, and the decision nearly
// so well, is taken.
template <class D>
HWY_INLINE void SolvePixels(D d, const Block& block, std::size_t first, BlockMatte* matte) {
  using V = hn::Vec<D>;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0f), weight = hn::Set(d, kDecisionWeight);
  const V luma_C = hn::LoadU(d, block.luma_C.data() + first),
          luma_B = hn::LoadU(d, block.luma_B.data() + first);
  const V prior = hn::LoadU(d, block.prior.data() + first);
  V B[3], off_B[3], inverse[3];  // off_B = C - B
  V length = zero;
  for (std::size_t c = 0; c < 3; ++c) {
    B[c] = hn::Add(hn::Set(d, block.B[c]), luma_B);
    off_B[c] = hn::Sub(hn::Add(hn::Set(d, block.C[c]), luma_C), B[c]);
    inverse[c] = hn::Set(d, 1 / (block.variance[c] + kClothSigma * kClothSigma));
    length = hn::MulAdd(hn::Mul(off_B[c], off_B[c]), inverse[c], length);
  }
  V best = hn::Set(d, 1e30f), alpha = prior, contrast_of_best = zero;
  V F[3];
  for (std::size_t c = 0; c < 3; ++c) F[c] = hn::Add(hn::Set(d, block.C[c]), luma_C);
  for (std::size_t i = 0; i < static_cast<std::size_t>(block.candidates); ++i) {
    V along = zero, contrast = zero;
    for (std::size_t c = 0; c < 3; ++c) {
      const V f = hn::Sub(hn::Set(d, block.F[i][c]), B[c]);
      const V scaled = hn::Mul(f, inverse[c]);
      along = hn::MulAdd(off_B[c], scaled, along);
      contrast = hn::MulAdd(f, scaled, contrast);
    }
    const V ratio = hn::Div(hn::MulAdd(weight, prior, along), hn::Add(contrast, weight));
    const V a = hn::Min(hn::Max(ratio, zero), one);
    const V residual = hn::MulAdd(a, hn::Sub(hn::Mul(a, contrast), hn::Add(along, along)), length);
    const V off = hn::Sub(a, prior);
    const V cost = hn::MulAdd(hn::Mul(hn::Set(d, kChoiceWeight), off), off, residual);
    const auto better = hn::Lt(cost, best);
    best = hn::IfThenElse(better, cost, best);
    alpha = hn::IfThenElse(better, a, alpha);
    contrast_of_best = hn::IfThenElse(better, contrast, contrast_of_best);
    for (std::size_t c = 0; c < 3; ++c) F[c] = hn::IfThenElse(better, hn::Set(d, block.F[i][c]), F[c]);
  }
  // F as the cloth beside has it, moved towards what C leaves for it.
  const V cloth = hn::Set(d, kClothSigma * kClothSigma);
  for (std::size_t c = 0; c < 3; ++c) {
    const V share = hn::Mul(alpha, cloth);
    const V gain = hn::Div(share, hn::MulAdd(share, alpha, hn::Set(d, block.variance[c])));
    const V left = hn::NegMulAdd(alpha, hn::Sub(F[c], B[c]), off_B[c]);
    const V own = hn::MulAdd(gain, left, F[c]);
    hn::StoreU(hn::Min(hn::Max(own, zero), hn::Set(d, 255.0f)), d, matte->F[c].data() + first);
  }
  // Light adds up, levels do not: they are about its root.
  V luma_F = zero, luma_of_B = zero;
  for (std::size_t c = 0; c < 3; ++c) {
    luma_F = hn::MulAdd(F[c], hn::Set(d, kLuma[c]), luma_F);
    luma_of_B = hn::MulAdd(B[c], hn::Set(d, kLuma[c]), luma_of_B);
  }
  const V step = hn::MulAdd(alpha, hn::Sub(luma_F, luma_of_B), hn::Add(luma_of_B, luma_of_B));
  alpha = hn::Div(hn::Mul(alpha, step), hn::Max(hn::Add(luma_F, luma_of_B), one));
  // Most pixels are wholly one or the other: what lies within a sigma of either is.
  const V sigma = hn::Div(hn::Set(d, kOneOfThree), hn::Sqrt(hn::Add(contrast_of_best, weight)));
  const V stretched = hn::Div(hn::Sub(alpha, sigma), hn::NegMulAdd(hn::Set(d, 2.0f), sigma, one));
  alpha = hn::Min(hn::Max(stretched, zero), one);
  hn::StoreU(alpha, d, matte->alpha.data() + first);
}

void SolveBlock(const Block& block, BlockMatte* matte) {
  const hn::CappedTag<float, 4> d;
  for (std::size_t first = 0; first < 4; first += hn::Lanes(d)) SolvePixels(d, block, first, matte);
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {
namespace {

HWY_EXPORT(SolveBlock);

Color At(const HalfPicture& picture, int x, int y) {
  return {static_cast<float>(picture.r.ptr<std::uint8_t>(y)[x]),
          static_cast<float>(picture.g.ptr<std::uint8_t>(y)[x]),
          static_cast<float>(picture.b.ptr<std::uint8_t>(y)[x])};
}

float LumaOf(const Color& rgb) { return kLuma[0] * rgb[0] + kLuma[1] * rgb[1] + kLuma[2] * rgb[2]; }

// The actor's colours around, and the brightness of the room beside against the empty set: 0.3..1.1.
float LookAround(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                 const cv::Mat1b& inner, const cv::Mat1b& outer, int x, int y, Block* block) {
  float now = 0, empty = 0;
  block->candidates = 0;
  for (const Offset& offset : kAround) {
    const int u = x + offset.x, v = y + offset.y;
    if (u < 0 || v < 0 || u >= inner.cols || v >= inner.rows) continue;
    if (inner.ptr<std::uint8_t>(v)[u] != 0) {
      block->F[static_cast<std::size_t>(block->candidates++)] = At(picture, u, v);
    } else if (outer.ptr<std::uint8_t>(v)[u] == 0 &&
               (empty == 0 || offset.x * offset.x + offset.y * offset.y <= 8)) {
      now += static_cast<float>(picture.g.ptr<std::uint8_t>(v)[u]);
      empty += tone.gain[1] * model.mean[1].ptr<float>(v)[u] + tone.offset[1];
    }
  }
  return empty > 1 ? std::clamp(now / empty, 0.3f, 1.1f) : 1.0f;
}

// What the four full-size pixels are brighter than theirs at half size, linearly between its neighbours.
std::array<float, 4> Slope(const cv::Mat1f& luma, int x, int y) {
  const int left = std::max(x - 1, 0), right = std::min(x + 1, luma.cols - 1);
  const float* above = luma.ptr<float>(std::max(y - 1, 0));
  const float* here = luma.ptr<float>(y);
  const float* below = luma.ptr<float>(std::min(y + 1, luma.rows - 1));
  const auto corner = [&](const float* beside, int side) {
    return (3 * (beside[x] + here[side]) + beside[side] - 7 * here[x]) / 16;
  };
  return {corner(above, left), corner(above, right), corner(below, left), corner(below, right)};
}

}  // namespace

// Among eight pixels from (x, y) on.
bool EdgeCoverage::HasBand(int x, int y) const {
  std::uint64_t inner = 0, outer = 0;
  std::memcpy(&inner, inner_.ptr<std::uint8_t>(y) + x, sizeof(inner));
  std::memcpy(&outer, outer_.ptr<std::uint8_t>(y) + x, sizeof(outer));
  return inner != outer;
}

void EdgeCoverage::Run(ImageView<const std::uint8_t> luma, const HalfPicture& picture,
                       const BackgroundModel& model, const ToneChange& tone, cv::Mat1b* decided,
                       cv::Mat1b* mask, ImageView<std::uint8_t> alpha) {
  MIX_CHECK(decided != nullptr && mask != nullptr && mask->size() == picture.r.size() &&
            decided->size() == mask->size());
  MIX_CHECK(SameSize(luma, alpha) && mask->cols == Half(luma.width()) && mask->rows == Half(luma.height()));
  const cv::Mat kernel = cv::getStructuringElement(cv::MORPH_ELLIPSE, {5, 5});
  cv::threshold(*mask, *mask, 0, 255, cv::THRESH_BINARY);
  cv::erode(*mask, inner_, kernel);
  cv::dilate(*mask, outer_, kernel);
  cv::bitwise_or(*decided, inner_, *decided);
  cv::bitwise_and(*decided, outer_, *decided);
  EnlargeTwice(*decided, alpha);
  foreground_.create(luma.height(), luma.width());
  band_.clear();
  Block block;
  BlockMatte matte;
  for (int y = 0; y < mask->rows; ++y) {
    const std::uint8_t* inner = inner_.ptr<std::uint8_t>(y);
    const std::uint8_t* outer = outer_.ptr<std::uint8_t>(y);
    const int bottom = std::min(2 * y + 1, luma.height() - 1);
    const std::array<const std::uint8_t*, 2> Y = {luma.row(2 * y), luma.row(bottom)};
    const std::array<std::uint8_t*, 2> out = {alpha.row(2 * y), alpha.row(bottom)};
    const std::array<cv::Vec3b*, 2> F = {foreground_[2 * y], foreground_[bottom]};
    for (int x = 0; x < mask->cols; ++x) {
      // Enlarging blends across the band's border: F is known inside it alone.
      const auto settle = [&](int u) {
        for (std::uint8_t* row : out) {
          row[2 * u] = inner[u];
          if (2 * u + 1 < luma.width()) row[2 * u + 1] = inner[u];
        }
      };
      if (x + 8 <= mask->cols && !HasBand(x, y)) {
        for (int u = x; u < x + 8; ++u) settle(u);
        x += 7;
        continue;
      }
      if (inner[x] == outer[x]) {
        settle(x);
        continue;
      }
      const float light = LookAround(picture, model, tone, inner_, outer_, x, y, &block);
      const std::array<int, 2> columns = {2 * x, std::min(2 * x + 1, luma.width() - 1)};
      block.C = At(picture, x, y);
      for (std::size_t c = 0; c < 3; ++c) {
        block.variance[c] = model.variance[c].ptr<float>(y)[x];
        block.B[c] =
            light * std::clamp(tone.gain[c] * model.mean[c].ptr<float>(y)[x] + tone.offset[c], 0.0f, 255.0f);
      }
      const float own = LumaOf(block.C);
      block.luma_B = Slope(model.mean_luma, x, y);
      for (std::size_t i = 0; i < 4; ++i) {
        const int column = columns[i % 2];
        block.luma_B[i] *= light * tone.luma_gain();
        block.luma_C[i] = static_cast<float>(Y[i / 2][column]) - own;
        block.prior[i] = static_cast<float>(out[i / 2][column]) / 255;
      }
      HWY_DYNAMIC_DISPATCH(SolveBlock)(block, &matte);
      band_.emplace_back(x, y);
      for (std::size_t i = 0; i < 4; ++i) {
        const int column = columns[i % 2];
        out[i / 2][column] = static_cast<std::uint8_t>(255 * matte.alpha[i] + 0.5f);
        for (int c = 0; c < 3; ++c)
          F[i / 2][column][c] = static_cast<std::uint8_t>(matte.F[static_cast<std::size_t>(c)][i] + 0.5f);
      }
    }
  }
  Smooth(mask, alpha);
}

// piVE 3's second median: what one pixel's colour says alone, in a cloth like the room, is noise.
void EdgeCoverage::Smooth(cv::Mat1b* mask, ImageView<std::uint8_t> alpha) {
  if (band_.empty()) return;
  const cv::Rect half = cv::boundingRect(band_);
  const cv::Rect box = cv::Rect(2 * half.x - 1, 2 * half.y - 1, 2 * half.width + 2, 2 * half.height + 2) &
                       cv::Rect(0, 0, alpha.width(), alpha.height());
  AsMat(alpha)(box).copyTo(solved_);
  cv::medianBlur(solved_, smooth_, 3);
  for (const cv::Point& at : band_) {
    int sum = 0;
    for (int i = 0; i < 4; ++i) {
      const int x = std::min(2 * at.x + i % 2, alpha.width() - 1),
                y = std::min(2 * at.y + i / 2, alpha.height() - 1);
      alpha.row(y)[x] = smooth_(y - box.y, x - box.x);
      sum += alpha.row(y)[x];
    }
    mask->ptr<std::uint8_t>(at.y)[at.x] = sum >= 2 * 255 ? 255 : 0;
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
