// SPDX-License-Identifier: Apache-2.0
//
// The header that all binary messages of the viewer stream begin with (SPEC.md 4.1), and numbers in its byte
// order. Private to proto/watch.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "proto/watch/picture_message.h"

namespace mixstage {

// Byte by byte, so that neither alignment nor the machine's byte order matters.
template <typename T>
[[nodiscard]] T ReadLittle(const std::uint8_t* bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{bytes[i]} << (8 * i);
  return static_cast<T>(value);
}
[[nodiscard]] inline float ReadFloat(const std::uint8_t* bytes) {
  return std::bit_cast<float>(ReadLittle<std::uint32_t>(bytes));
}

template <typename T>
void WriteLittle(T value, std::uint8_t* bytes) {
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    bytes[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
  }
}
inline void WriteFloat(float value, std::uint8_t* bytes) {
  WriteLittle(std::bit_cast<std::uint32_t>(value), bytes);
}

// Header and payload of a message of one of the streams first..last; near_m and far_m are read as they are.
[[nodiscard]] tl::expected<WatchPictureView, WatchRefusal> ReadWatchMessage(
    std::span<const std::uint8_t> message, WatchStream first, WatchStream last);

// The header and room for the payload, filled with 0. 1..kMaxWatchPayloadBytes bytes (checked).
[[nodiscard]] std::vector<std::uint8_t> BeginWatchMessage(const WatchHeader& header,
                                                          std::size_t payload_bytes);

}  // namespace mixstage
