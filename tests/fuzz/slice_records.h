// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <span>

#include "proto/link/frame_slice.h"

namespace mixstage {

// Fuzzer bytes as a stream of slices, so that one input exercises the state behind many. A record is a time
// step (1 byte, tenths of a second), the slice's fields from epoch to encoding as they lie on the wire (46
// bytes), a count (1 byte) and so many bytes of payload, filled up with zeros; its checksum is made to fit.
// Calls take(slice, now_us) for each record.
template <typename Take>
void ForEachSlice(std::span<const std::uint8_t> bytes, Take take) {
  constexpr std::size_t kFieldBytes = 46;
  mixstage_lcm::frame_slice_t slice{};
  std::int64_t now_us = 1'000'000;
  while (bytes.size() >= kFieldBytes + 2) {
    std::size_t at = 0;
    auto read = [&]<typename T>(T& field) {
      std::uint64_t value = 0;
      for (std::size_t i = 0; i < sizeof(T); ++i) value = value << 8 | bytes[at++];
      field = static_cast<T>(value);
    };
    std::uint8_t step = 0;
    std::uint8_t count = 0;
    read(step), read(slice.epoch), read(slice.t_us), read(slice.sequence);
    read(slice.frame_bytes), read(slice.frame_crc32c), read(slice.width), read(slice.height);
    read(slice.slice), read(slice.data_slices), read(slice.parity_slices), read(slice.slice_bytes);
    read(slice.stream), read(slice.encoding), read(count);
    now_us += step * std::int64_t{100'000};
    bytes = bytes.subspan(at);
    const auto payload = bytes.first(std::min<std::size_t>(count, bytes.size()));
    std::memset(slice.payload, 0, sizeof slice.payload);
    std::copy(payload.begin(), payload.end(), slice.payload);
    slice.slice_crc32c = static_cast<std::int32_t>(SliceCrc32c(slice));
    bytes = bytes.subspan(payload.size());
    take(slice, now_us);
  }
}

}  // namespace mixstage
