// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "proto/base/bounded_queue.h"
#include "proto/base/result.h"
#include "proto/watch/mesh_message.h"

namespace mixstage {

// Watched meshes as files beside the pictures of a dump: mesh/actor_FRAME.drc, room.drc, object_ID.drc
// (Draco) with textures of the same name (.jpg), and mesh.txt, which gives the actor's capture times as the
// lists of a take do (SPEC.md 5). The disk does not hold the watching up: what it cannot keep up with is left
// out.
class MeshDump {
 public:
  struct Counts {
    std::int64_t written = 0, left_out = 0;
  };
  // Fails (kInvalidConfig) where FOLDER/mesh cannot be made.
  static Result<std::unique_ptr<MeshDump>> Create(const std::filesystem::path& folder);
  ~MeshDump() { Finish(); }
  MeshDump(const MeshDump&) = delete;
  MeshDump& operator=(const MeshDump&) = delete;

  // One thread. Copies.
  void Mesh(const WatchMesh& mesh);
  // Writes what waits; nothing is taken any more.
  Counts Finish();

 private:
  struct Files {
    std::string name;             // without suffix
    std::int64_t capture_us = 0;  // of an actor; else 0
    std::vector<std::uint8_t> mesh, texture;
  };
  explicit MeshDump(std::filesystem::path folder);
  void RunWrite();
  [[nodiscard]] bool Write(const Files& files) const;

  const std::filesystem::path folder_;
  BoundedQueue<Files> waiting_;
  std::int64_t pushed_out_ = 0;            // of who calls Mesh()
  std::int64_t written_ = 0, failed_ = 0;  // of the writing thread
  std::jthread thread_;
};

}  // namespace mixstage
