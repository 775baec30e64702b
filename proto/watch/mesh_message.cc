// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/mesh_message.h"

#include <algorithm>
#include <cmath>

#include "proto/base/check.h"
#include "proto/watch/message_bytes.h"

namespace mixstage {
namespace {

bool PartsFit(const WatchMesh& mesh) {
  if (mesh.mesh.empty()) return mesh.stream == WatchStream::kActorMesh && mesh.texture.empty();
  return mesh.mesh.size() <= kMaxMeshBytes && mesh.texture.size() <= kMaxMeshBytes - mesh.mesh.size();
}
bool IdFits(const WatchMesh& mesh) { return (mesh.stream == WatchStream::kObjectMesh) == (mesh.id != 0); }

}  // namespace

tl::expected<WatchMesh, WatchRefusal> ReadWatchMesh(std::span<const std::uint8_t> message) {
  const auto read = ReadWatchMessage(message, WatchStream::kActorMesh, WatchStream::kObjectMesh);
  if (!read) return tl::unexpected(read.error());
  const std::span<const std::uint8_t> payload = read->payload;
  if (payload.size() < kMeshPrefixBytes) return tl::unexpected(WatchRefusal::kParts);
  const std::size_t parts_bytes = payload.size() - kMeshPrefixBytes;
  const std::size_t mesh_bytes = ReadLittle<std::uint32_t>(payload.data() + 4);
  const std::size_t texture_bytes = ReadLittle<std::uint32_t>(payload.data() + 8);
  if (mesh_bytes > parts_bytes || texture_bytes != parts_bytes - mesh_bytes) {
    return tl::unexpected(WatchRefusal::kParts);
  }
  WatchMesh mesh{.stream = read->header.stream,
                 .frame = read->header.frame,
                 .capture_us = read->header.capture_us,
                 .encoded_us = read->header.encoded_us,
                 .id = ReadLittle<std::uint32_t>(payload.data()),
                 .mesh = payload.subspan(kMeshPrefixBytes, mesh_bytes),
                 .texture = payload.subspan(kMeshPrefixBytes + mesh_bytes)};
  if (!PartsFit(mesh)) return tl::unexpected(WatchRefusal::kParts);
  if (!IdFits(mesh)) return tl::unexpected(WatchRefusal::kId);
  for (std::size_t i = 0; i < mesh.T_scene_color.size(); ++i) {
    mesh.T_scene_color[i] = ReadFloat(payload.data() + 12 + 4 * i);
    if (!std::isfinite(mesh.T_scene_color[i])) return tl::unexpected(WatchRefusal::kPose);
  }
  return mesh;
}

std::vector<std::uint8_t> WriteWatchMesh(const WatchMesh& mesh) {
  MIX_CHECK(mesh.stream >= WatchStream::kActorMesh && mesh.stream <= WatchStream::kObjectMesh);
  MIX_CHECK(PartsFit(mesh) && IdFits(mesh));
  std::vector<std::uint8_t> message =
      BeginWatchMessage({.stream = mesh.stream,
                         .key_frame = true,
                         .frame = mesh.frame,
                         .capture_us = mesh.capture_us,
                         .encoded_us = mesh.encoded_us},
                        kMeshPrefixBytes + mesh.mesh.size() + mesh.texture.size());
  std::uint8_t* payload = message.data() + kWatchHeaderBytes;
  WriteLittle(mesh.id, payload);
  WriteLittle(static_cast<std::uint32_t>(mesh.mesh.size()), payload + 4);
  WriteLittle(static_cast<std::uint32_t>(mesh.texture.size()), payload + 8);
  for (std::size_t i = 0; i < mesh.T_scene_color.size(); ++i) {
    WriteFloat(mesh.T_scene_color[i], payload + 12 + 4 * i);
  }
  std::copy(mesh.mesh.begin(), mesh.mesh.end(), payload + kMeshPrefixBytes);
  std::copy(mesh.texture.begin(), mesh.texture.end(), payload + kMeshPrefixBytes + mesh.mesh.size());
  return message;
}

}  // namespace mixstage
