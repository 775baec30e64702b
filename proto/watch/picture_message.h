// SPDX-License-Identifier: Apache-2.0
//
// Picture messages of the viewer stream (SPEC.md 4.1): a 48-byte header and one H.264 access unit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <tl/expected.hpp>
#include <vector>

namespace mixstage {

enum class WatchStream : std::uint8_t {
  kColor = 1,  // the composite, 8 bit
  kDepth = 2,  // depth, matte and label, 10 bit
  kActorMesh = 3,
  kRoomMesh = 4,
  kObjectMesh = 5,
  kLightMap = 6,  // a JPEG
};
// The streams that are decoded one picture after the other; meshes (mesh_message.h) and light maps are whole
// in each message.
inline constexpr std::size_t kWatchStreams = 2;
// 0 for colour, 1 for depth: a place in an array of kWatchStreams.
[[nodiscard]] constexpr std::size_t StreamIndex(WatchStream stream) {
  return static_cast<std::size_t>(stream) - 1;
}
// "color", "depth", "mesh" for all three of meshes, "light": the names in text messages.
[[nodiscard]] std::string_view StreamName(WatchStream stream);

inline constexpr std::size_t kWatchHeaderBytes = 48;
inline constexpr std::size_t kMaxWatchPayloadBytes = 8'388'608;

struct WatchHeader {
  WatchStream stream = WatchStream::kColor;
  bool key_frame = false;       // decoding can start here
  std::uint64_t frame = 0;      // counts the camera's pictures, skipped ones too
  std::int64_t capture_us = 0;  // server clock, mid-exposure of the colour picture
  std::int64_t encoded_us = 0;  // server clock when the encoder was done
  float near_m = 0;             // depth stream: depth of code 1023; colour: 0
  float far_m = 0;              // depth stream: depth of code 1; colour: 0
  bool operator==(const WatchHeader&) const = default;
};

struct WatchPictureView {
  WatchHeader header;
  std::span<const std::uint8_t> payload;  // inside the message that was read
};

// Why a message was refused, in the order the checks are made (the last three: meshes only).
enum class WatchRefusal {
  kShort = 1,  // fewer than 48 bytes
  kMagic,
  kHeader,  // header_bytes < 48 or beyond the message
  kLength,  // payload_bytes is 0, too large or does not fit the message exactly
  kStream,
  kRange,  // depth stream: not 0 < near_m < far_m, or not finite
  kParts,  // the payload is not 60 bytes, mesh and texture; a part is missing or too large
  kId,     // objects have an id from 1, actor and room the id 0
  kPose,   // a number of T_scene_color is not finite
};
// "short", "magic", ...: the names in SPEC.md, for counters.
[[nodiscard]] std::string_view RefusalName(WatchRefusal refusal);

// Any bytes; nothing is copied: the payload is a view into `message`.
[[nodiscard]] tl::expected<WatchPictureView, WatchRefusal> ReadWatchPicture(
    std::span<const std::uint8_t> message);

// The whole message. The payload must have 1..kMaxWatchPayloadBytes bytes (checked).
[[nodiscard]] std::vector<std::uint8_t> WriteWatchPicture(const WatchHeader& header,
                                                          std::span<const std::uint8_t> payload);

}  // namespace mixstage
