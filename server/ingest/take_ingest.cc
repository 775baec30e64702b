// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/take_ingest.h"

#include <algorithm>
#include <cmath>

#include "proto/take/picture_files.h"
#include "server/ingest/head_track.h"

namespace mixstage {
namespace {

// Half a microsecond: times in lists are decimal roundings of one instant.
constexpr double kSameInstantS = 1e-6;
constexpr std::ptrdiff_t kHeadReadings = 32;

template <typename Entry>
std::ptrdiff_t LastAtOrBefore(const std::vector<Entry>& entries, double t_s) {
  const auto after = std::upper_bound(entries.begin(), entries.end(), t_s + kSameInstantS,
                                      [](double t, const Entry& e) { return t < e.t_s; });
  return after - entries.begin() - 1;
}

}  // namespace

TakeIngest::TakeIngest(const Take& take, const Rig& rig) : take_(take), rig_(rig) {}

Result<std::shared_ptr<const CapturedFrame>> TakeIngest::Load(int index, std::string& warning) {
  MIX_CHECK(index >= 0 && index < frames());
  warning.clear();
  const TakeEntry& entry = take_.color[static_cast<std::size_t>(index)];
  auto frame = std::make_shared<CapturedFrame>();
  frame->frame = index;
  frame->capture_us = std::llround(entry.t_s * 1e6);
  frame->take_t_s = entry.t_s;
  frame->stem = entry.stem();
  if (auto ok = LoadColor(entry.file, jpeg_, frame->color); !ok) return tl::unexpected(ok.error());
  if (frame->color.width() != rig_.color.width || frame->color.height() != rig_.color.height) {
    return Fail(ErrorCode::kBadInput,
                entry.file.string() + ": is " + std::to_string(frame->color.width()) + " x " +
                    std::to_string(frame->color.height()) + " pixels, the rig's colour camera has " +
                    std::to_string(rig_.color.width) + " x " + std::to_string(rig_.color.height));
  }
  if (rig_.depth) {
    const std::ptrdiff_t at = LastAtOrBefore(take_.depth, entry.t_s - rig_.depth_time_offset_s);
    if (at >= 0) {
      auto depth = LoadDepth(static_cast<std::size_t>(at));
      if (depth) {
        frame->depth = *depth;
      } else {
        warning = depth.error().message;
      }
    }
  }
  // The readings around the picture.
  HeadTrack head;
  const std::ptrdiff_t last = LastAtOrBefore(take_.head, entry.t_s + 1e-6 * HeadTrack::kReachUs);
  for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, last - kHeadReadings); i <= last; ++i) {
    const HeadSample& sample = take_.head[static_cast<std::size_t>(i)];
    head.Add(std::llround(sample.t_s * 1e6), {sample.pan_deg, sample.tilt_deg});
  }
  frame->head = head.At(std::llround(entry.t_s * 1e6));
  return frame;
}

Result<std::shared_ptr<const DepthPicture>> TakeIngest::LoadDepth(std::size_t index) {
  if (loaded_ && loaded_index_ == index) return loaded_;
  const TakeEntry& entry = take_.depth[index];
  auto depth = std::make_shared<DepthPicture>();
  depth->capture_us = std::llround((entry.t_s + rig_.depth_time_offset_s) * 1e6);
  depth->sequence = static_cast<std::int64_t>(index);
  if (auto ok = LoadDepth16(entry.file, depth->counts); !ok) return tl::unexpected(ok.error());
  if (const std::ptrdiff_t at = LastAtOrBefore(take_.amplitude, entry.t_s);
      at >= 0 && std::abs(take_.amplitude[static_cast<std::size_t>(at)].t_s - entry.t_s) < kSameInstantS) {
    // Amplitude only helps: without it the depth is used as it is.
    cv::Mat1w amplitude;
    if (LoadDepth16(take_.amplitude[static_cast<std::size_t>(at)].file, amplitude) &&
        amplitude.size() == depth->counts.size()) {
      depth->amplitude = amplitude;
    }
  }
  loaded_index_ = index;
  loaded_ = std::move(depth);
  return loaded_;
}

}  // namespace mixstage
