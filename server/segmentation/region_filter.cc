// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/region_filter.h"

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "proto/base/check.h"
#include "server/segmentation/color_evidence.h"

namespace mixstage {
namespace {

// Of an actor who enters, the picture's border shows a strip.
constexpr float kOfOneWhoEnters = 0.1f;

static_assert(kNoEvidence == 128, "EndOfStretch compares eight bytes at once with 128");

// Top bit of each byte: whether it is above 128.
std::uint64_t Above128(const std::uint8_t* from) {
  std::uint64_t bytes = 0;
  std::memcpy(&bytes, from, sizeof(bytes));
  constexpr std::uint64_t kLowBits = 0x7F7F7F7F7F7F7F7F;
  return ((bytes & kLowBits) + kLowBits) & bytes & ~kLowBits;
}

// First column after `begin` that is on the other side; width if none.
int EndOfStretch(const std::uint8_t* side, int begin, int width, bool actor) {
  const std::uint64_t same = actor ? 0x8080808080808080 : 0;
  int end = begin;
  while (end + 8 <= width && Above128(side + end) == same) end += 8;
  while (end < width && (side[end] > kNoEvidence) == actor) ++end;
  return end;
}

int SumLimited(const std::uint8_t* own, int begin, int end) {
  constexpr int kLimit = static_cast<int>(3 / kEvidencePerByte);
  int sum = 0;
  for (int x = begin; x < end; ++x) sum += std::min(std::max(own[x] - kNoEvidence, -kLimit), kLimit);
  return sum;
}

}  // namespace

int RegionFilter::Find(int region) {
  while (regions_[static_cast<std::size_t>(region)].parent != region) {
    Region& r = regions_[static_cast<std::size_t>(region)];
    r.parent = regions_[static_cast<std::size_t>(r.parent)].parent;
    region = r.parent;
  }
  return region;
}

void RegionFilter::Unite(int a, int b) {
  a = Find(a);
  b = Find(b);
  if (a == b) return;
  Region& keep = regions_[static_cast<std::size_t>(std::min(a, b))];
  Region& gone = regions_[static_cast<std::size_t>(std::max(a, b))];
  keep.area += gone.area;
  keep.evidence += gone.evidence;
  keep.border = keep.border || gone.border;
  gone.parent = keep.parent;
}

void RegionFilter::LabelRow(const cv::Mat1b& decision, const cv::Mat1b& evidence, int y,
                            std::size_t above_begin) {
  const std::uint8_t* side = decision.ptr<std::uint8_t>(y);
  const std::uint8_t* own = evidence.ptr<std::uint8_t>(y);
  const std::size_t above_end = stretches_.size();
  std::size_t above = above_begin;
  const int width = decision.cols;
  for (int begin = 0; begin < width;) {
    const bool actor = side[begin] > kNoEvidence;
    const int end = EndOfStretch(side, begin, width, actor);
    const bool border = begin == 0 || end == width || y == 0 || y + 1 == decision.rows;
    const int region = static_cast<int>(regions_.size());
    // Evidence decides on actors and on holes: the room at the border is neither.
    const int sum = actor || !border ? SumLimited(own, begin, end) : 0;
    regions_.push_back({region, end - begin, static_cast<float>(sum) * kEvidencePerByte, actor, border});
    while (above < above_end && stretches_[above].end <= begin) ++above;
    for (std::size_t i = above; i < above_end && stretches_[i].begin < end; ++i) {
      if (regions_[static_cast<std::size_t>(stretches_[i].region)].actor == actor)
        Unite(region, stretches_[i].region);
    }
    stretches_.push_back({y, begin, end, region});
    begin = end;
  }
}

void RegionFilter::Run(const cv::Mat1b& evidence, const RegionConfig& config, cv::Mat1b* decision) {
  MIX_CHECK(evidence.size() == decision->size());
  stretches_.clear();
  regions_.clear();
  std::size_t above_begin = 0;
  for (int y = 0; y < decision->rows; ++y) {
    const std::size_t row_begin = stretches_.size();
    LabelRow(*decision, evidence, y, above_begin);
    above_begin = row_begin;
  }
  const auto pixels = static_cast<float>(decision->total());
  // A pixel of clear actor holds 3 log-odds; hands seen alone need about half of that.
  const float least = 1.5f * std::max(config.least_actor_share * pixels, 4.0f);
  const float largest_hole = config.largest_hole_share * pixels;
  for (const Stretch& s : stretches_) {
    const Region& region = regions_[static_cast<std::size_t>(Find(s.region))];
    const auto area = static_cast<float>(region.area);
    const bool drop = region.actor && region.evidence < (region.border ? kOfOneWhoEnters * least : least);
    // A hole is filled unless its pixels show the room by a log-odd each.
    const bool fill = !region.actor && !region.border && area < largest_hole && region.evidence > -area;
    if (!drop && !fill) continue;
    std::uint8_t* row = decision->ptr<std::uint8_t>(s.y);
    std::fill(row + s.begin, row + s.end, static_cast<std::uint8_t>(drop ? 0 : 255));
  }
}

}  // namespace mixstage
