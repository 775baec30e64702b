// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/picture_message.h"

#include <bit>
#include <cmath>
#include <cstring>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr std::uint32_t kMagic = 0x3157584D;  // "MXW1"
constexpr std::uint8_t kKeyFrameFlag = 1;

// Byte by byte, so that neither alignment nor the machine's byte order matters.
template <typename T>
T ReadLittle(const std::uint8_t* bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) value |= std::uint64_t{bytes[i]} << (8 * i);
  return static_cast<T>(value);
}
float ReadFloat(const std::uint8_t* bytes) { return std::bit_cast<float>(ReadLittle<std::uint32_t>(bytes)); }

template <typename T>
void WriteLittle(T value, std::uint8_t* bytes) {
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    bytes[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
  }
}

}  // namespace

std::string_view StreamName(WatchStream stream) { return stream == WatchStream::kColor ? "color" : "depth"; }

std::string_view RefusalName(WatchRefusal refusal) {
  switch (refusal) {
    case WatchRefusal::kShort:
      return "short";
    case WatchRefusal::kMagic:
      return "magic";
    case WatchRefusal::kHeader:
      return "header";
    case WatchRefusal::kLength:
      return "length";
    case WatchRefusal::kStream:
      return "stream";
    case WatchRefusal::kRange:
      return "range";
  }
  return "unknown";
}

tl::expected<WatchPictureView, WatchRefusal> ReadWatchPicture(std::span<const std::uint8_t> message) {
  if (message.size() < kWatchHeaderBytes) return tl::unexpected(WatchRefusal::kShort);
  const std::uint8_t* bytes = message.data();
  if (ReadLittle<std::uint32_t>(bytes) != kMagic) return tl::unexpected(WatchRefusal::kMagic);
  const std::size_t header_bytes = ReadLittle<std::uint16_t>(bytes + 6);
  if (header_bytes < kWatchHeaderBytes || header_bytes > message.size()) {
    return tl::unexpected(WatchRefusal::kHeader);
  }
  const std::size_t payload_bytes = ReadLittle<std::uint32_t>(bytes + 32);
  if (payload_bytes == 0 || payload_bytes > kMaxWatchPayloadBytes ||
      payload_bytes != message.size() - header_bytes) {
    return tl::unexpected(WatchRefusal::kLength);
  }
  if (bytes[4] != 1 && bytes[4] != 2) return tl::unexpected(WatchRefusal::kStream);
  WatchPictureView picture;
  picture.header.stream = static_cast<WatchStream>(bytes[4]);
  picture.header.key_frame = (bytes[5] & kKeyFrameFlag) != 0;
  picture.header.frame = ReadLittle<std::uint64_t>(bytes + 8);
  picture.header.capture_us = ReadLittle<std::int64_t>(bytes + 16);
  picture.header.encoded_us = ReadLittle<std::int64_t>(bytes + 24);
  if (picture.header.stream == WatchStream::kDepth) {
    const float near_m = ReadFloat(bytes + 36);
    const float far_m = ReadFloat(bytes + 40);
    if (!std::isfinite(near_m) || !std::isfinite(far_m) || !(0 < near_m && near_m < far_m)) {
      return tl::unexpected(WatchRefusal::kRange);
    }
    picture.header.near_m = near_m;
    picture.header.far_m = far_m;
  }
  picture.payload = message.subspan(header_bytes);
  return picture;
}

std::vector<std::uint8_t> WriteWatchPicture(const WatchHeader& header,
                                            std::span<const std::uint8_t> payload) {
  MIX_CHECK(!payload.empty() && payload.size() <= kMaxWatchPayloadBytes);
  std::vector<std::uint8_t> message(kWatchHeaderBytes + payload.size());
  std::uint8_t* bytes = message.data();
  WriteLittle(kMagic, bytes);
  bytes[4] = static_cast<std::uint8_t>(header.stream);
  bytes[5] = header.key_frame ? kKeyFrameFlag : 0;
  WriteLittle(static_cast<std::uint16_t>(kWatchHeaderBytes), bytes + 6);
  WriteLittle(header.frame, bytes + 8);
  WriteLittle(header.capture_us, bytes + 16);
  WriteLittle(header.encoded_us, bytes + 24);
  WriteLittle(static_cast<std::uint32_t>(payload.size()), bytes + 32);
  WriteLittle(std::bit_cast<std::uint32_t>(header.near_m), bytes + 36);
  WriteLittle(std::bit_cast<std::uint32_t>(header.far_m), bytes + 40);
  std::memcpy(bytes + kWatchHeaderBytes, payload.data(), payload.size());
  return message;
}

}  // namespace mixstage
