// SPDX-License-Identifier: Apache-2.0
//
// An encoded picture as datagrams and back (SPEC.md 2.2). A lost fragment of one large LCM message loses the
// whole message and its buffers; slices of one datagram each do not.
#pragma once

#include <cstdint>
#include <functional>
#include <mixstage_lcm/frame_slice_t.hpp>
#include <span>
#include <vector>

#include "proto/base/result.h"
#include "proto/link/parity.h"

namespace mixstage {

enum class Stream : std::int8_t { kColor = 1, kDepth = 2, kAmplitude = 3, kFisheye = 4 };
enum class Encoding : std::int8_t { kJpeg = 1, kDepth16 = 2 };

inline constexpr int kSlicePayloadBytes = 1280;
inline constexpr std::int32_t kMaxFrameBytes = 8 << 20;
inline constexpr int kMaxPictureSide = 8192;  // px

// An encoded picture with what the server must know about it before decoding.
struct EncodedFrame {
  std::int64_t epoch = 0;     // of the agent's start
  std::int64_t t_us = 0;      // agent's clock, mid-exposure
  std::int64_t sequence = 0;  // counts the stream's pictures, dropped ones too
  Stream stream = Stream::kColor;
  Encoding encoding = Encoding::kJpeg;
  int width = 0, height = 0;  // px
  std::vector<std::uint8_t> bytes;
};

// Cuts a picture into slices, data first (a picture that loses nothing waits for no parity), then parity of
// the given strength (share of the data slices, 0 .. 1; parity.h), and hands each to `send`. The slice is
// reused between calls. A picture that is empty or over the limits is a caller's bug (checked).
void CutIntoSlices(const EncodedFrame& frame,
                   const std::function<void(const mixstage_lcm::frame_slice_t&)>& send,
                   double parity = kDefaultParity);

// CRC-32C over every field of a slice but slice_crc32c, as they lie on the wire.
[[nodiscard]] std::uint32_t SliceCrc32c(const mixstage_lcm::frame_slice_t& slice);

// Within +-2^53: of such times and numbers sums and differences cannot overflow.
[[nodiscard]] constexpr bool IsCountable(std::int64_t number) {
  return number >= -(std::int64_t{1} << 53) && number <= std::int64_t{1} << 53;
}

// What a slice from the network must satisfy before any field is used; names the first field that does not.
// Of a damaged slice that is slice_crc32c, unless a field went out of its range.
Status ValidateSlice(const mixstage_lcm::frame_slice_t& slice);

}  // namespace mixstage
