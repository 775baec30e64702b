// SPDX-License-Identifier: Apache-2.0
#include "proto/link/reassembler.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "proto/base/crc32c.h"

namespace mixstage {
namespace {

bool SamePicture(const mixstage_lcm::frame_slice_t& a, const mixstage_lcm::frame_slice_t& b) {
  return a.t_us == b.t_us && a.frame_bytes == b.frame_bytes && a.frame_crc32c == b.frame_crc32c &&
         a.width == b.width && a.height == b.height && a.data_slices == b.data_slices &&
         a.slice_bytes == b.slice_bytes && a.encoding == b.encoding;
}

}  // namespace

std::optional<EncodedFrame> Reassembler::Add(const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us) {
  ++counters_.slices;
  if (!ValidateSlice(slice)) {
    ++counters_.bad_slice;
    return std::nullopt;
  }
  if (slice.slice >= slice.data_slices) {
    ++counters_.parity_slice;
    return std::nullopt;
  }
  Source* source = FindSource(slice.epoch, now_us);
  if (source == nullptr) {
    ++counters_.no_room;
    return std::nullopt;
  }
  StreamState& stream = source->streams[static_cast<std::size_t>(slice.stream)];
  if (slice.sequence <= stream.finished_up_to && !stream.open.contains(slice.sequence)) {
    ++counters_.late_slice;
    return std::nullopt;
  }
  OpenFrame* frame = FindFrame(stream, slice);
  if (frame == nullptr) return std::nullopt;
  if (!SamePicture(frame->head, slice)) {
    ++counters_.bad_slice;
    return std::nullopt;
  }
  const auto index = static_cast<std::size_t>(slice.slice);
  if (frame->have[index]) {
    ++counters_.duplicate_slice;
    return std::nullopt;
  }
  frame->have[index] = true;
  const std::size_t begin = index * static_cast<std::size_t>(slice.slice_bytes);
  const std::size_t count =
      std::min(static_cast<std::size_t>(slice.slice_bytes), frame->bytes.size() - begin);
  std::memcpy(frame->bytes.data() + begin, slice.payload, count);
  if (--frame->missing > 0) return std::nullopt;
  return Finish(stream, *frame);
}

Reassembler::Source* Reassembler::FindSource(std::int64_t epoch, std::int64_t now_us) {
  auto found = sources_.find(epoch);
  if (found == sources_.end()) {
    if (static_cast<int>(sources_.size()) >= kMaxSources) {
      const auto quietest = std::min_element(
          sources_.begin(), sources_.end(),
          [](const auto& a, const auto& b) { return a.second.last_heard_us < b.second.last_heard_us; });
      if (now_us - quietest->second.last_heard_us < kSourceSilenceUs) return nullptr;
      for (StreamState& stream : quietest->second.streams) {
        while (!stream.open.empty()) GiveUpOldest(stream);
      }
      sources_.erase(quietest);
    }
    found = sources_.emplace(epoch, Source{}).first;
  }
  found->second.last_heard_us = now_us;
  return &found->second;
}

Reassembler::OpenFrame* Reassembler::FindFrame(StreamState& stream,
                                               const mixstage_lcm::frame_slice_t& slice) {
  if (auto found = stream.open.find(slice.sequence); found != stream.open.end()) return &found->second;
  while (static_cast<int>(stream.open.size()) >= kMaxOpenFrames) {
    // Older than everything that is being put together: it would be the next to be given up anyway.
    if (slice.sequence < stream.open.begin()->first) {
      ++counters_.late_slice;
      return nullptr;
    }
    GiveUpOldest(stream);
  }
  const auto size = static_cast<std::size_t>(slice.frame_bytes);
  if (open_bytes_ + size > kMaxOpenBytes) {
    ++counters_.no_room;
    return nullptr;
  }
  OpenFrame& frame = stream.open[slice.sequence];
  open_bytes_ += size;
  frame.head = slice;
  frame.bytes.resize(size);
  frame.have.assign(static_cast<std::size_t>(slice.data_slices), false);
  frame.missing = slice.data_slices;
  return &frame;
}

void Reassembler::GiveUpOldest(StreamState& stream) {
  const auto oldest = stream.open.begin();
  ++counters_.incomplete;
  open_bytes_ -= oldest->second.bytes.size();
  stream.finished_up_to = std::max(stream.finished_up_to, oldest->first);
  stream.open.erase(oldest);
}

std::optional<EncodedFrame> Reassembler::Finish(StreamState& stream, OpenFrame& frame) {
  EncodedFrame whole;
  whole.epoch = frame.head.epoch;
  whole.t_us = frame.head.t_us;
  whole.sequence = frame.head.sequence;
  whole.stream = static_cast<Stream>(frame.head.stream);
  whole.encoding = static_cast<Encoding>(frame.head.encoding);
  whole.width = frame.head.width;
  whole.height = frame.head.height;
  whole.bytes = std::move(frame.bytes);
  open_bytes_ -= whole.bytes.size();
  const bool intact = Crc32c(whole.bytes) == static_cast<std::uint32_t>(frame.head.frame_crc32c);
  const std::int64_t sequence = whole.sequence;
  stream.open.erase(sequence);
  if (!intact) {
    ++counters_.crc;
    stream.finished_up_to = std::max(stream.finished_up_to, sequence);
    return std::nullopt;
  }
  // What is older can no longer be shown in order: it is given up now, so that its memory is free.
  while (!stream.open.empty() && stream.open.begin()->first < sequence) GiveUpOldest(stream);
  stream.finished_up_to = std::max(stream.finished_up_to, sequence);
  ++counters_.frames;
  return whole;
}

}  // namespace mixstage
