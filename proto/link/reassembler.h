// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>

#include "proto/link/frame_slice.h"
#include "proto/link/open_picture.h"
#include "proto/link/slice_loss.h"
#include "proto/link/source_quota.h"

namespace mixstage {

// Slices to whole pictures, in order, each once, only when its CRC-32C fits.
//
// Datagrams may be lost (parity repairs), doubled, damaged and out of order. A picture is delivered at once
// when all before it were; otherwise it waits for them until kReorderSlices further slices of its source have
// come (twice the 64 datagrams of disorder that must change nothing) or for kReorderWaitUs: then what is
// older is given up.
//
// Memory is bounded whatever arrives: at most kMaxSources (epochs), per source and stream kMaxOpenPictures
// pictures in the making, all together kMaxOpenBytes, parity counted. When that is full, the source that uses
// the most gives up the picture that it has not added to for longest; a source's rate is bounded by its
// SourceQuota. So no source can push out another. One thread.
class Reassembler {
 public:
  static constexpr int kMaxSources = 8;
  static constexpr int kMaxOpenPictures = 128;
  static constexpr std::size_t kMaxOpenBytes = std::size_t{64} << 20;
  static constexpr std::int64_t kReorderSlices = 128;
  static constexpr std::int64_t kReorderWaitUs = 60'000;
  // Its place may be taken by another after so long; sooner if none of its pictures ever became whole.
  static constexpr std::int64_t kSourceSilenceUs = 5'000'000, kUnprovenSilenceUs = 500'000;
  // A stream that takes nothing for so long because its slices are too old starts afresh: its last number was
  // a lie.
  static constexpr std::int64_t kResyncUs = 1'000'000;

  struct Counters {
    std::int64_t slices = 0;     // all that arrived
    std::int64_t frames = 0;     // delivered
    std::int64_t repaired = 0;   // of these: made whole by parity
    std::int64_t bad_slice = 0;  // refused by ValidateSlice, or contradicting what is known of its picture
    std::int64_t duplicate_slice = 0;  // seen before
    std::int64_t spare_slice = 0;      // of a picture that was whole without it
    std::int64_t late_slice = 0;       // of a picture that was given up, or older than what was delivered
    std::int64_t incomplete = 0;       // pictures given up with slices missing
    std::int64_t crc = 0;              // pictures given up whose bytes do not fit their CRC
    std::int64_t quota = 0;            // slices refused: their source sends too much
    std::int64_t no_room = 0;          // slices refused: too many sources or too much memory
  };
  // Of one source.
  struct SourceStats {
    std::int64_t repaired = 0;  // pictures, since its start
    double slice_loss = 0;      // 0 .. 1 over the last 10 s, pictures of which nothing came left out
  };

  // Takes one slice; then take what became whole: `while (auto picture = Next(now_us))`.
  void Add(const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us);
  // The next whole picture. Call it now and then although no slice comes: the last picture may be waiting.
  std::optional<EncodedFrame> Next(std::int64_t now_us);

  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] SourceStats Stats(std::int64_t epoch, std::int64_t now_us);
  [[nodiscard]] std::size_t open_bytes() const { return open_bytes_; }

 private:
  struct Open {
    OpenPicture picture;
    std::int64_t opened_at = 0, opened_us = 0;  // at: the source's count of slices
    std::int64_t touched_at = 0;
  };
  // A picture that is delivered or given up, while slices of it may still be under way.
  struct Settling {
    PictureKey key;
    SlicesSeen seen;
    bool delivered = false;
    std::int64_t at = 0, at_us = 0;
  };
  using OpenPictures = std::map<PictureKey, Open>;
  struct StreamState {
    OpenPictures open;
    int waiting = 0;                   // of these: whole, but out of order
    std::int64_t finished_up_to = -1;  // pictures up to here are delivered or given up
    std::int64_t finished_us = 0;
    std::deque<Settling> settling;
  };
  struct Source {
    std::int64_t last_heard_us = 0;
    std::int64_t slices = 0;  // that came, each once
    std::int64_t repaired = 0;
    bool proven = false;  // a picture became whole
    std::size_t open_bytes = 0;
    SourceQuota quota;
    SliceLoss loss;
    std::array<StreamState, 5> streams;  // by stream number
  };

  Source* FindSource(std::int64_t epoch, std::int64_t now_us);
  // A place for a new picture; end() when it gets none.
  OpenPictures::iterator OpenNew(Source& source, StreamState& stream,
                                 const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us);
  bool MakeRoom(Source& source, std::size_t bytes, std::int64_t now_us);
  void AddToSettling(Source& source, StreamState& stream, const mixstage_lcm::frame_slice_t& slice);
  void Release(Source& source, StreamState& stream, std::int64_t now_us);
  void ReleaseAll(Source& source, std::int64_t now_us);
  void DeliverFirstWhole(Source& source, StreamState& stream, std::int64_t now_us);
  void GiveUp(Source& source, StreamState& stream, OpenPictures::iterator picture, std::int64_t now_us);
  void Settle(Source& source, StreamState& stream, const PictureKey& key, const OpenPicture& picture,
              std::int64_t now_us);
  static void SettleOld(Source& source, StreamState& stream, std::int64_t now_us);

  std::map<std::int64_t, Source> sources_;  // by epoch
  std::deque<EncodedFrame> ready_;
  std::size_t open_bytes_ = 0;
  std::int64_t next_sweep_us_ = 0;
  ParityCoder coder_;
  Counters counters_;
};

}  // namespace mixstage
