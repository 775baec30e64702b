// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/neighbor_vote.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "proto/base/check.h"
#include "server/segmentation/color_evidence.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/neighbor_vote.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

#include "server/segmentation/bytes-inl.h"

#ifndef MIXSTAGE_NEIGHBOR_VOTE_ROW_
#define MIXSTAGE_NEIGHBOR_VOTE_ROW_
namespace mixstage {

// One row of the picture and the room, and the one whose pixels are compared with it.
struct EdgeRow {
  std::array<const std::uint8_t*, 3> picture, picture_next;
  std::array<const std::uint8_t*, 3> room, room_next;
  const std::uint8_t* around;
  const std::uint8_t* around_next;
  const float* light;
  const float* light_next;
  float* keep;
};

// Reach of the first round in a stretch without edges, half pixels; the second reaches half as far.
inline constexpr float kReach = 18.0f;
// Sum over the channels, grey levels above the noise, across which nothing is handed on.
inline constexpr float kFullEdge = 228.0f;
inline constexpr float kDarkest = 0.2f;
// Where evidence turns there is rather an outline, most of all where both sides would be one actor: levels
// for each step of its mean.
inline constexpr float kTurnOfActor = 1.0f;
inline constexpr float kTurnOfRoom = 0.25f;
inline constexpr int kRounds = 2;
// Beyond, evidence is only more certain of the same.
inline constexpr float kClear = 3.0f;

}  // namespace mixstage
#endif

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class D>
HWY_INLINE void LightAt(D d, const EdgeRow& row, std::size_t x, float* light) {
  auto along = hn::Zero(d);
  auto length = hn::Set(d, 1.0f);
  for (std::size_t c = 0; c < 3; ++c) {
    const auto room = LoadByte(d, row.room[c] + x);
    along = hn::MulAdd(LoadByte(d, row.picture[c] + x), room, along);
    length = hn::MulAdd(room, room, length);
  }
  const auto ratio = hn::Div(along, length);
  hn::StoreU(hn::Min(hn::Max(ratio, hn::Set(d, kDarkest)), hn::Set(d, 1.0f)), d, light + x);
}

// Contrast to the next pixel: the least of what the picture shows and what remains of it once the room's own
// contrast, as it is or in shadow, is taken off.
template <class D>
HWY_INLINE void KeepAt(D d, const EdgeRow& row, std::size_t x, float noise, float most) {
  const auto light = hn::Min(hn::LoadU(d, row.light + x), hn::LoadU(d, row.light_next + x));
  const auto turn = hn::Abs(hn::Sub(LoadByte(d, row.around_next + x), LoadByte(d, row.around + x)));
  auto plain = hn::Mul(turn, hn::Set(d, kTurnOfActor));
  auto lit = hn::Mul(turn, hn::Set(d, kTurnOfRoom)), dark = lit;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto seen = hn::Sub(LoadByte(d, row.picture_next[c] + x), LoadByte(d, row.picture[c] + x));
    const auto room = hn::Sub(LoadByte(d, row.room_next[c] + x), LoadByte(d, row.room[c] + x));
    plain = hn::Add(plain, hn::Abs(seen));
    lit = hn::Add(lit, hn::Abs(hn::Sub(seen, room)));
    dark = hn::Add(dark, hn::Abs(hn::NegMulAdd(light, room, seen)));
  }
  const auto contrast = hn::Max(hn::Sub(hn::Min(plain, hn::Min(lit, dark)), hn::Set(d, noise)), hn::Zero(d));
  const auto open =
      hn::Max(hn::NegMulAdd(contrast, hn::Set(d, 1 / kFullEdge), hn::Set(d, 1.0f)), hn::Zero(d));
  const auto squared = hn::Mul(open, open);
  hn::StoreU(hn::Mul(hn::Mul(squared, squared), hn::Set(d, most)), d, row.keep + x);
}

template <class Step>
HWY_INLINE void ForRow(std::size_t width, const Step& step) {
  const hn::ScalableTag<float> d;
  const std::size_t lanes = hn::Lanes(d);
  std::size_t x = 0;
  for (; x + lanes <= width; x += lanes) step(d, x);
  for (; x < width; ++x) step(hn::CappedTag<float, 1>(), x);
}

void LightRow(const EdgeRow& row, std::size_t width, float* light) {
  ForRow(width, [&](auto d, std::size_t x) HWY_ATTR { LightAt(d, row, x, light); });
}

void KeepRow(const EdgeRow& row, std::size_t width, float noise, float most) {
  ForRow(width, [&](auto d, std::size_t x) HWY_ATTR { KeepAt(d, row, x, noise, most); });
}

// to += keep^(1 + round) * (from - to)
void HandOnRow(const float* HWY_RESTRICT from, const float* HWY_RESTRICT keep, int round, std::size_t width,
               float* HWY_RESTRICT to) {
  ForRow(width, [&](auto d, std::size_t x) HWY_ATTR {
    auto share = hn::LoadU(d, keep + x);
    if (round == 1) share = hn::Mul(share, share);
    const auto own = hn::LoadU(d, to + x);
    hn::StoreU(hn::MulAdd(share, hn::Sub(hn::LoadU(d, from + x), own), own), d, to + x);
  });
}

void LoadVotes(const std::uint8_t* HWY_RESTRICT evidence, std::size_t width, float* HWY_RESTRICT vote) {
  ForRow(width, [&](auto d, std::size_t x) HWY_ATTR {
    const auto own = LoadLogOdds(d, evidence + x);
    hn::StoreU(hn::Min(hn::Max(own, hn::Set(d, -kClear)), hn::Set(d, kClear)), d, vote + x);
  });
}

void DecideRow(const std::uint8_t* HWY_RESTRICT evidence, const float* HWY_RESTRICT vote, float own_weight,
               std::size_t width, std::uint8_t* HWY_RESTRICT decision) {
  ForRow(width, [&](auto d, std::size_t x) HWY_ATTR {
    const auto own = hn::Sub(LoadByte(d, evidence + x), hn::Set(d, kNoEvidence));
    const auto mean =
        hn::MulAdd(hn::LoadU(d, vote + x), hn::Set(d, 1 / kEvidencePerByte), hn::Set(d, kNoEvidence + 0.5f));
    const auto sum = hn::MulAdd(own, hn::Set(d, own_weight), mean);
    StoreByte(d, sum, decision + x);
  });
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {
namespace {

HWY_EXPORT(LightRow);
HWY_EXPORT(KeepRow);
HWY_EXPORT(HandOnRow);
HWY_EXPORT(LoadVotes);
HWY_EXPORT(DecideRow);

// Blocks in which at least kLeast of kBlock^2 pixels speak for an actor; what he may be lies within kMargin
// of them.
constexpr int kBlock = 8;
constexpr int kLeast = 6;
constexpr int kMargin = 16;

// Sum over the channels of |difference| that two pixels of one surface show by noise alone, typically: of the
// quarter of the room that is known best, the rest is the model's doubt and no noise of the camera's.
float NoiseOfContrast(const BackgroundModel& model) {
  constexpr int kStep = 16;
  std::vector<float> sums;
  for (int y = kStep / 2; y < model.variance[0].rows; y += kStep) {
    for (int x = kStep / 2; x < model.variance[0].cols; x += kStep) {
      float sum = 0;
      for (const cv::Mat1f& variance : model.variance) sum += std::sqrt(variance(y, x));
      sums.push_back(sum);
    }
  }
  if (sums.empty()) return 0;
  const auto quarter = sums.begin() + static_cast<std::ptrdiff_t>(sums.size() / 4);
  std::nth_element(sums.begin(), quarter, sums.end());
  return 1.128f * *quarter;  // E|a - b| = 2 sigma / sqrt(pi)
}

// Many rows beside each other: each one's recursion waits for its last product, eight do not.
void HandOnAlong(cv::Mat1f* vote, const cv::Mat1f& keep, int first, int rows, int round) {
  constexpr int kTogether = 8;
  std::array<float*, kTogether> v{};
  std::array<const float*, kTogether> k{};
  std::array<float, kTogether> last{};
  for (int i = 0; i < kTogether; ++i) {
    const auto at = static_cast<std::size_t>(i);
    v[at] = vote->ptr<float>(first + std::min(i, rows - 1));
    k[at] = keep.ptr<float>(first + std::min(i, rows - 1));
    last[at] = v[at][0];
  }
  const auto share = [&](std::size_t i, int x) { return round == 1 ? k[i][x] * k[i][x] : k[i][x]; };
  const auto count = static_cast<std::size_t>(rows);
  for (int x = 1; x < vote->cols; ++x) {
    for (std::size_t i = 0; i < count; ++i) {
      const float own = v[i][x];
      last[i] = own + share(i, x - 1) * (last[i] - own);
      v[i][x] = last[i];
    }
  }
  for (int x = vote->cols - 2; x >= 0; --x) {
    for (std::size_t i = 0; i < count; ++i) {
      const float own = v[i][x];
      last[i] = own + share(i, x) * (last[i] - own);
      v[i][x] = last[i];
    }
  }
}

}  // namespace

cv::Rect NeighborVote::BoxOfActors(const cv::Mat1b& evidence) const {
  int left = evidence.cols, right = 0, top = evidence.rows, bottom = 0;
  for (int y = 0; y < evidence.rows; y += kBlock) {
    for (int x = 0; x < evidence.cols; x += kBlock) {
      if (x >= left && x < right && y >= top && y < bottom) continue;
      int count = 0;
      for (int v = y; v < std::min(y + kBlock, evidence.rows); ++v) {
        const std::uint8_t* row = evidence.ptr<std::uint8_t>(v);
        for (int u = x; u < std::min(x + kBlock, evidence.cols); ++u) count += row[u] > kNoEvidence ? 1 : 0;
      }
      if (count < kLeast) continue;
      left = std::min(left, x);
      right = std::max(right, x + kBlock);
      top = std::min(top, y);
      bottom = std::max(bottom, y + kBlock);
    }
  }
  if (left >= right) return {};
  const cv::Rect around(left - kMargin, top - kMargin, right - left + 2 * kMargin,
                        bottom - top + 2 * kMargin);
  return around & cv::Rect({0, 0}, evidence.size());
}

void NeighborVote::FindEdges(const HalfPicture& picture, const BackgroundModel& model,
                             const ToneChange& tone) {
  const cv::Mat1b around = around_(box_);
  const std::array<cv::Mat1b, 3> now = {picture.r(box_), picture.g(box_), picture.b(box_)};
  for (std::size_t c = 0; c < 3; ++c)
    model.mean[c](box_).convertTo(room_[c], CV_8U, tone.gain[c], tone.offset[c]);
  for (cv::Mat1f* plane : {&light_, &keep_right_, &keep_down_}) plane->create(box_.size());
  const float noise = NoiseOfContrast(model);
  const float most = std::exp(-std::sqrt(2.0f) / kReach);
  const auto width = static_cast<std::size_t>(box_.width);
  const auto row_at = [&](int y) {
    EdgeRow row{};
    for (std::size_t c = 0; c < 3; ++c) {
      row.picture[c] = now[c].ptr<std::uint8_t>(y);
      row.room[c] = room_[c].ptr<std::uint8_t>(y);
      row.picture_next[c] = row.picture[c] + 1;
      row.room_next[c] = row.room[c] + 1;
    }
    row.around = around.ptr<std::uint8_t>(y);
    row.around_next = row.around + 1;
    row.light = light_.ptr<float>(y);
    row.light_next = row.light + 1;
    row.keep = keep_right_.ptr<float>(y);
    return row;
  };
  for (int y = 0; y < box_.height; ++y) {
    HWY_DYNAMIC_DISPATCH(LightRow)(row_at(y), width, light_.ptr<float>(y));
  }
  for (int y = 0; y < box_.height; ++y) {
    EdgeRow row = row_at(y);
    if (width > 1) HWY_DYNAMIC_DISPATCH(KeepRow)(row, width - 1, noise, most);
    if (y + 1 == box_.height) break;
    for (std::size_t c = 0; c < 3; ++c) {
      row.picture_next[c] = now[c].ptr<std::uint8_t>(y + 1);
      row.room_next[c] = room_[c].ptr<std::uint8_t>(y + 1);
    }
    row.around_next = around.ptr<std::uint8_t>(y + 1);
    row.light_next = light_.ptr<float>(y + 1);
    row.keep = keep_down_.ptr<float>(y);
    HWY_DYNAMIC_DISPATCH(KeepRow)(row, width, noise, most);
  }
}

void NeighborVote::FilterAlongRows(int round) {
  constexpr int kTogether = 8;
  for (int y = 0; y < box_.height; y += kTogether)
    HandOnAlong(&vote_, keep_right_, y, std::min(kTogether, box_.height - y), round);
}

void NeighborVote::FilterAlongColumns(int round) {
  const auto width = static_cast<std::size_t>(box_.width);
  for (int y = 1; y < box_.height; ++y) {
    HWY_DYNAMIC_DISPATCH(HandOnRow)
    (vote_.ptr<float>(y - 1), keep_down_.ptr<float>(y - 1), round, width, vote_.ptr<float>(y));
  }
  for (int y = box_.height - 2; y >= 0; --y) {
    HWY_DYNAMIC_DISPATCH(HandOnRow)
    (vote_.ptr<float>(y + 1), keep_down_.ptr<float>(y), round, width, vote_.ptr<float>(y));
  }
}

void NeighborVote::Run(const cv::Mat1b& evidence, const HalfPicture& picture, const BackgroundModel& model,
                       const ToneChange& tone, float own_weight, cv::Mat1b* decision) {
  MIX_CHECK(decision != nullptr && evidence.size() == picture.r.size() &&
            evidence.size() == model.mean[0].size());
  decision->create(evidence.size());
  cv::min(evidence, kNoEvidence - static_cast<int>(1 / kEvidencePerByte), *decision);
  box_ = BoxOfActors(evidence);
  if (box_.empty()) return;
  box_mean_.Run(evidence, &around_);
  FindEdges(picture, model, tone);
  vote_.create(box_.size());
  const auto width = static_cast<std::size_t>(box_.width);
  for (int y = 0; y < box_.height; ++y) {
    HWY_DYNAMIC_DISPATCH(LoadVotes)
    (evidence.ptr<std::uint8_t>(box_.y + y) + box_.x, width, vote_.ptr<float>(y));
  }
  for (int round = 0; round < kRounds; ++round) {
    FilterAlongRows(round);
    FilterAlongColumns(round);
  }
  for (int y = 0; y < box_.height; ++y) {
    HWY_DYNAMIC_DISPATCH(DecideRow)
    (evidence.ptr<std::uint8_t>(box_.y + y) + box_.x, vote_.ptr<float>(y), own_weight, width,
     decision->ptr<std::uint8_t>(box_.y + y) + box_.x);
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
