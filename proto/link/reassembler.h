// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "proto/link/frame_slice.h"

namespace mixstage {

// Slices to whole pictures, with a memory that is bounded whatever arrives: at most kMaxSources (epochs), per
// source and stream at most kMaxOpenFrames pictures in the making of at most kMaxFrameBytes each, all
// together at most kMaxOpenBytes. A picture is delivered once, only when its CRC-32C fits. One thread.
class Reassembler {
 public:
  static constexpr int kMaxSources = 8;
  static constexpr int kMaxOpenFrames = 4;
  static constexpr std::size_t kMaxOpenBytes = std::size_t{64} << 20;
  static constexpr std::int64_t kSourceSilenceUs = 5'000'000;  // then its place may be taken by another

  struct Counters {
    std::int64_t slices = 0;     // all that arrived
    std::int64_t frames = 0;     // delivered
    std::int64_t bad_slice = 0;  // refused by ValidateSlice, or contradicting the picture they belong to
    std::int64_t duplicate_slice = 0;  // seen before
    std::int64_t late_slice = 0;       // of a picture that is delivered or given up
    std::int64_t parity_slice = 0;     // parity, not used yet
    std::int64_t incomplete = 0;       // pictures given up with slices missing
    std::int64_t crc = 0;              // pictures whose bytes do not fit their CRC
    std::int64_t no_room = 0;          // slices refused: too many sources or too much memory
  };

  // Takes one slice; returns the picture it completes.
  std::optional<EncodedFrame> Add(const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us);

  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  struct OpenFrame {
    mixstage_lcm::frame_slice_t head{};  // the first slice seen: what all others must agree with
    std::vector<std::uint8_t> bytes;
    std::vector<bool> have;
    int missing = 0;
  };
  struct StreamState {
    std::map<std::int64_t, OpenFrame> open;  // by sequence
    std::int64_t finished_up_to = -1;        // pictures up to here are delivered or given up
  };
  struct Source {
    std::int64_t last_heard_us = 0;
    std::array<StreamState, 5> streams;  // by stream number
  };

  Source* FindSource(std::int64_t epoch, std::int64_t now_us);
  OpenFrame* FindFrame(StreamState& stream, const mixstage_lcm::frame_slice_t& slice);
  void GiveUpOldest(StreamState& stream);
  std::optional<EncodedFrame> Finish(StreamState& stream, OpenFrame& frame);

  std::map<std::int64_t, Source> sources_;  // by epoch
  std::size_t open_bytes_ = 0;
  Counters counters_;
};

}  // namespace mixstage
