// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstdint>
#include <vector>

#include "proto/link/frame_slice.h"

namespace mixstage {

// What all slices of a picture have in common; ordered by sequence first. Slices that differ in any of it
// belong to different pictures, so that a slice that lies about a picture cannot spoil it.
struct PictureKey {
  std::int64_t sequence = 0, t_us = 0;
  std::int32_t frame_bytes = 0, frame_crc32c = 0;
  std::int16_t width = 0, height = 0, data_slices = 0, parity_slices = 0, slice_bytes = 0;
  std::int8_t encoding = 0;
  auto operator<=>(const PictureKey&) const = default;
};
[[nodiscard]] PictureKey KeyOf(const mixstage_lcm::frame_slice_t& slice);

// Which slices of a picture came, data first.
class SlicesSeen {
 public:
  explicit SlicesSeen(const PictureKey& key);
  bool Mark(std::int16_t slice);  // false: it came before
  [[nodiscard]] int count() const { return count_; }
  [[nodiscard]] int expected() const { return static_cast<int>(seen_.size()); }

 private:
  std::vector<bool> seen_;
  int count_ = 0;
};

// One picture in the making. Its slices are stored as they come; as soon as those of every parity group
// suffice, missing ones are solved for, and CRC-32C over the whole picture decides. One that does not fit
// (a forged slice) stays open: parity slices that are still to come, or another choice among those that are
// there, may make it whole. At most kMaxAttempts times, so that a liar costs little.
class OpenPicture {
 public:
  static constexpr int kMaxAttempts = 16;

  explicit OpenPicture(const mixstage_lcm::frame_slice_t& first);

  // What a slice of this picture, checked by ValidateSlice, brought.
  enum class Brought {
    kNew = 1,
    kSpare,          // it came for the first time, but the picture is whole without it
    kDuplicate,      // it came before
    kContradiction,  // the same slice with another content: with parity neither copy is believed any more
  };
  Brought Add(const mixstage_lcm::frame_slice_t& slice);
  // Restores and checks when there is enough; true when the picture is whole. Then Add stores nothing more.
  bool TryFinish(ParityCoder& coder);

  [[nodiscard]] bool whole() const { return whole_; }
  [[nodiscard]] bool repaired() const { return whole_ && missing_data_ > 0; }
  // Enough came, but what came does not fit the CRC.
  [[nodiscard]] bool damaged() const { return !whole_ && attempts_ > 0; }
  // Every slice came: what is not whole now never will be.
  [[nodiscard]] bool complete() const { return seen_.count() == seen_.expected(); }
  [[nodiscard]] const SlicesSeen& seen() const { return seen_; }
  // What a picture in the making takes, bookkeeping counted.
  [[nodiscard]] static std::size_t MemoryBytes(const PictureKey& key);

  // The whole picture; leaves nothing behind.
  EncodedFrame Take();

 private:
  std::uint8_t* Place(std::size_t slice);
  void Count(std::size_t slice, int came);  // +1 a slice came, -1 it is not believed any more
  bool Fits() const;

  EncodedFrame frame_;  // bytes: all data slices, the last zero-filled, until Take()
  std::size_t data_slices_, slice_bytes_, frame_bytes_;
  std::uint32_t crc32c_;
  std::vector<std::uint8_t> parity_bytes_;
  std::vector<bool> have_data_, have_parity_, contradicted_;
  SlicesSeen seen_;
  std::vector<int> short_by_;  // by parity group: missing data minus parity that came
  int groups_short_ = 0, missing_data_ = 0, attempts_ = 0;
  bool whole_ = false;
};

}  // namespace mixstage
