// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/picture_message.h"

#include <cmath>
#include <cstring>

#include "proto/base/check.h"
#include "proto/watch/message_bytes.h"

namespace mixstage {
namespace {

constexpr std::uint32_t kMagic = 0x3157584D;  // "MXW1"
constexpr std::uint8_t kKeyFrameFlag = 1;

}  // namespace

std::string_view StreamName(WatchStream stream) {
  switch (stream) {
    case WatchStream::kColor:
      return "color";
    case WatchStream::kDepth:
      return "depth";
    case WatchStream::kActorMesh:
    case WatchStream::kRoomMesh:
    case WatchStream::kObjectMesh:
      return "mesh";
    case WatchStream::kLightMap:
      return "light";
  }
  return "unknown";
}

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
    case WatchRefusal::kParts:
      return "parts";
    case WatchRefusal::kId:
      return "id";
    case WatchRefusal::kPose:
      return "pose";
  }
  return "unknown";
}

tl::expected<WatchPictureView, WatchRefusal> ReadWatchMessage(std::span<const std::uint8_t> message,
                                                              WatchStream first, WatchStream last) {
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
  if (bytes[4] < static_cast<std::uint8_t>(first) || bytes[4] > static_cast<std::uint8_t>(last)) {
    return tl::unexpected(WatchRefusal::kStream);
  }
  WatchPictureView read;
  read.header.stream = static_cast<WatchStream>(bytes[4]);
  read.header.key_frame = (bytes[5] & kKeyFrameFlag) != 0;
  read.header.frame = ReadLittle<std::uint64_t>(bytes + 8);
  read.header.capture_us = ReadLittle<std::int64_t>(bytes + 16);
  read.header.encoded_us = ReadLittle<std::int64_t>(bytes + 24);
  read.header.near_m = ReadFloat(bytes + 36);
  read.header.far_m = ReadFloat(bytes + 40);
  read.payload = message.subspan(header_bytes);
  return read;
}

std::vector<std::uint8_t> BeginWatchMessage(const WatchHeader& header, std::size_t payload_bytes) {
  MIX_CHECK(payload_bytes > 0 && payload_bytes <= kMaxWatchPayloadBytes);
  std::vector<std::uint8_t> message(kWatchHeaderBytes + payload_bytes);
  std::uint8_t* bytes = message.data();
  WriteLittle(kMagic, bytes);
  bytes[4] = static_cast<std::uint8_t>(header.stream);
  bytes[5] = header.key_frame ? kKeyFrameFlag : 0;
  WriteLittle(static_cast<std::uint16_t>(kWatchHeaderBytes), bytes + 6);
  WriteLittle(header.frame, bytes + 8);
  WriteLittle(header.capture_us, bytes + 16);
  WriteLittle(header.encoded_us, bytes + 24);
  WriteLittle(static_cast<std::uint32_t>(payload_bytes), bytes + 32);
  WriteFloat(header.near_m, bytes + 36);
  WriteFloat(header.far_m, bytes + 40);
  return message;
}

tl::expected<WatchPictureView, WatchRefusal> ReadWatchPicture(std::span<const std::uint8_t> message) {
  auto picture = ReadWatchMessage(message, WatchStream::kColor, WatchStream::kDepth);
  if (!picture) return picture;
  WatchHeader& header = picture->header;
  if (header.stream == WatchStream::kColor) {
    header.near_m = header.far_m = 0;
  } else if (!std::isfinite(header.near_m) || !std::isfinite(header.far_m) ||
             !(0 < header.near_m && header.near_m < header.far_m)) {
    return tl::unexpected(WatchRefusal::kRange);
  }
  return picture;
}

std::vector<std::uint8_t> WriteWatchPicture(const WatchHeader& header,
                                            std::span<const std::uint8_t> payload) {
  std::vector<std::uint8_t> message = BeginWatchMessage(header, payload.size());
  std::memcpy(message.data() + kWatchHeaderBytes, payload.data(), payload.size());
  return message;
}

}  // namespace mixstage
