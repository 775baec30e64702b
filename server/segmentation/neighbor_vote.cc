// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/neighbor_vote.h"

#include <algorithm>
#include <cstdint>

#include "server/segmentation/color_evidence.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/segmentation/neighbor_vote.cc"
#include <hwy/foreach_target.h>  // IWYU pragma: keep
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Full vote (+-125) at +-3 log-odds: where tanh(L / 2), which mean field asks for, has all but saturated.
inline constexpr int kFullVote = static_cast<int>(3 / kEvidencePerByte) + 2;
inline constexpr int kVoteFactor = 5;  // in halves: 50 * 5 / 2 = 125

void VoteRow(const std::uint8_t* HWY_RESTRICT from, int width, std::uint8_t* HWY_RESTRICT to) {
  const hn::ScalableTag<std::int16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto middle = hn::Set(d16, kNoEvidence);
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    const auto own = hn::Sub(hn::PromoteTo(d16, hn::LoadU(d8, from + x)), middle);
    const auto limited = hn::Min(hn::Max(own, hn::Set(d16, -kFullVote)), hn::Set(d16, kFullVote));
    const auto vote = hn::ShiftRight<1>(hn::Mul(limited, hn::Set(d16, kVoteFactor)));
    hn::StoreU(hn::DemoteTo(d8, hn::Add(vote, middle)), d8, to + x);
  }
  for (; x < width; ++x) {
    const int limited = std::min(std::max(from[x] - kNoEvidence, -kFullVote), kFullVote);
    to[x] = static_cast<std::uint8_t>(kNoEvidence + ((limited * kVoteFactor) >> 1));
  }
}

// to = own + weight * (mean - 128) / 128, saturating.
void AddVoteRow(const std::uint8_t* HWY_RESTRICT own, const std::uint8_t* HWY_RESTRICT mean, int weight,
                int width, std::uint8_t* HWY_RESTRICT to) {
  const hn::ScalableTag<std::int16_t> d16;
  const hn::Rebind<std::uint8_t, decltype(d16)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d16));
  const auto middle = hn::Set(d16, kNoEvidence);
  const auto factor = hn::Set(d16, static_cast<std::int16_t>(weight));
  int x = 0;
  for (; x + lanes <= width; x += lanes) {
    const auto vote = hn::Sub(hn::PromoteTo(d16, hn::LoadU(d8, mean + x)), middle);
    const auto sum =
        hn::Add(hn::PromoteTo(d16, hn::LoadU(d8, own + x)), hn::ShiftRight<7>(hn::Mul(vote, factor)));
    hn::StoreU(hn::DemoteTo(d8, sum), d8, to + x);
  }
  for (; x < width; ++x) {
    const int sum = own[x] + (((mean[x] - kNoEvidence) * weight) >> 7);
    to[x] = static_cast<std::uint8_t>(std::min(std::max(sum, 0), 255));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace mixstage
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(VoteRow);
HWY_EXPORT(AddVoteRow);

void NeighborVote::Run(const cv::Mat1b& evidence, float strength, int rounds, cv::Mat1b* decision) {
  vote_.create(evidence.size());
  evidence.copyTo(*decision);
  // A product of two bytes' worth must stay within 16 bits.
  const int weight = static_cast<int>(std::min(strength / kEvidencePerByte, 255.0f));
  for (int round = 0; round < rounds; ++round) {
    for (int y = 0; y < evidence.rows; ++y) {
      HWY_DYNAMIC_DISPATCH(VoteRow)
      (decision->ptr<std::uint8_t>(y), evidence.cols, vote_.ptr<std::uint8_t>(y));
    }
    box_.Run(vote_, &mean_);
    for (int y = 0; y < evidence.rows; ++y) {
      HWY_DYNAMIC_DISPATCH(AddVoteRow)
      (evidence.ptr<std::uint8_t>(y), mean_.ptr<std::uint8_t>(y), weight, evidence.cols,
       decision->ptr<std::uint8_t>(y));
    }
  }
}

}  // namespace mixstage
#endif  // HWY_ONCE
