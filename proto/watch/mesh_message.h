// SPDX-License-Identifier: Apache-2.0
//
// Mesh messages of the viewer stream (SPEC.md 4.3): the actor, the room, an object; each whole in itself.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <tl/expected.hpp>
#include <vector>

#include "proto/watch/picture_message.h"

namespace mixstage {

inline constexpr std::size_t kMeshPrefixBytes = 60;  // id, lengths and pose, in front of the mesh
inline constexpr std::size_t kMaxMeshBytes = kMaxWatchPayloadBytes - kMeshPrefixBytes;  // mesh and texture

// Rows of the 3 x 4 matrix of T_scene_color, metres.
using WatchPose = std::array<float, 12>;
inline constexpr WatchPose kIdentityPose = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

struct WatchMesh {
  WatchStream stream = WatchStream::kActorMesh;  // kActorMesh, kRoomMesh or kObjectMesh
  std::uint64_t frame = 0;                       // as in a picture message
  std::int64_t capture_us = 0, encoded_us = 0;   // server clock
  std::uint32_t id = 0;                          // of the object, from 1; actor and room: 0
  WatchPose T_scene_color = kIdentityPose;       // actor: where the colour camera was; else identity
  std::span<const std::uint8_t> mesh{};          // Draco; empty: there is no actor in view
  std::span<const std::uint8_t> texture{};       // JPEG, or empty
};

// Any bytes; nothing is copied: mesh and texture are views into `message` and as untrusted as it is.
[[nodiscard]] tl::expected<WatchMesh, WatchRefusal> ReadWatchMesh(std::span<const std::uint8_t> message);

// The whole message. Checked: the stream is one of meshes, mesh and texture together have at most
// kMaxMeshBytes, only an actor's mesh is empty and then without texture, ids are as above.
[[nodiscard]] std::vector<std::uint8_t> WriteWatchMesh(const WatchMesh& mesh);

}  // namespace mixstage
