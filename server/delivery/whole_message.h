// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "proto/watch/mesh_message.h"

namespace mixstage {

// A mesh or a light map as it goes to every viewer: a message of SPEC.md 4.1 or 4.3 that needs no other.
// Written once, then shared.
struct WholeMessage {
  WatchStream stream = WatchStream::kActorMesh;
  std::uint32_t id = 0;  // of an object
  std::vector<std::uint8_t> bytes;
};

[[nodiscard]] inline std::shared_ptr<const WholeMessage> MakeMeshMessage(const WatchMesh& mesh) {
  return std::make_shared<const WholeMessage>(WholeMessage{mesh.stream, mesh.id, WriteWatchMesh(mesh)});
}

[[nodiscard]] inline std::shared_ptr<const WholeMessage> MakeLightMapMessage(
    const WatchHeader& header, std::span<const std::uint8_t> jpeg) {
  return std::make_shared<const WholeMessage>(
      WholeMessage{header.stream, 0, WriteWatchPicture(header, jpeg)});
}

// Of others only the newest is of use.
[[nodiscard]] inline bool IsStanding(WatchStream stream) {
  return stream == WatchStream::kRoomMesh || stream == WatchStream::kObjectMesh;
}

// The meshes that stand until they are replaced: the room and the objects. Each gets the next number when it
// is put here, so that a viewer's place in the list is one number, whatever was replaced meanwhile.
class StandingMeshes {
 public:
  void Put(std::shared_ptr<const WholeMessage> mesh) {
    Remove(mesh->stream, mesh->id);
    meshes_.push_back({++last_number_, std::move(mesh)});
  }
  void Remove(WatchStream stream, std::uint32_t id) {
    std::erase_if(meshes_, [&](const Numbered& m) { return m.mesh->stream == stream && m.mesh->id == id; });
  }

  struct Numbered {
    std::uint64_t number = 0;
    std::shared_ptr<const WholeMessage> mesh;  // null: there is none
  };
  // The first whose number is above `number`.
  [[nodiscard]] Numbered After(std::uint64_t number) const {
    for (const Numbered& m : meshes_) {
      if (m.number > number) return m;
    }
    return {};
  }

 private:
  std::vector<Numbered> meshes_;  // numbers rise
  std::uint64_t last_number_ = 0;
};

}  // namespace mixstage
