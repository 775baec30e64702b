// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "proto/watch/mesh_message.h"

namespace mixstage {

// One mesh as it goes to every viewer: the message of SPEC.md 4.3. Written once, then shared.
struct MeshMessage {
  WatchStream stream = WatchStream::kActorMesh;
  std::uint32_t id = 0;  // of an object
  std::vector<std::uint8_t> bytes;
};

[[nodiscard]] inline std::shared_ptr<const MeshMessage> MakeMeshMessage(const WatchMesh& mesh) {
  return std::make_shared<const MeshMessage>(MeshMessage{mesh.stream, mesh.id, WriteWatchMesh(mesh)});
}

// The meshes that stand until they are replaced: the room and the objects. Each gets the next number when it
// is put here, so that a viewer's place in the list is one number, whatever was replaced meanwhile.
class StandingMeshes {
 public:
  void Put(std::shared_ptr<const MeshMessage> mesh) {
    Remove(mesh->stream, mesh->id);
    meshes_.push_back({++last_number_, std::move(mesh)});
  }
  void Remove(WatchStream stream, std::uint32_t id) {
    std::erase_if(meshes_, [&](const Numbered& m) { return m.mesh->stream == stream && m.mesh->id == id; });
  }

  struct Numbered {
    std::uint64_t number = 0;
    std::shared_ptr<const MeshMessage> mesh;  // null: there is none
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
