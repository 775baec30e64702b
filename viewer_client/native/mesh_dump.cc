// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/mesh_dump.h"

#include <cstdio>
#include <fstream>
#include <span>
#include <utility>

#include "proto/base/log.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kWaiting = 32;  // 2.5 s of the actor

bool WriteBytes(const fs::path& file, std::span<const std::uint8_t> bytes) {
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  return static_cast<bool>(out.flush());
}

std::string NameOf(const WatchMesh& mesh) {
  switch (mesh.stream) {
    case WatchStream::kRoomMesh:
      return "room";
    case WatchStream::kObjectMesh:
      return "object_" + std::to_string(mesh.id);
    default:
      return "actor_" + std::to_string(mesh.frame);
  }
}

}  // namespace

Result<std::unique_ptr<MeshDump>> MeshDump::Create(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder / "mesh", error);
  if (error) return Fail(ErrorCode::kInvalidConfig, "--dump " + folder.string() + ": " + error.message());
  return std::unique_ptr<MeshDump>(new MeshDump(folder));
}

MeshDump::MeshDump(fs::path folder)
    : folder_(std::move(folder)),
      waiting_(kWaiting, WhenFull::kDropOldest),
      thread_([this] { RunWrite(); }) {}

void MeshDump::Mesh(const WatchMesh& mesh) {
  if (mesh.mesh.empty()) return;  // nobody is in view
  pushed_out_ += waiting_.Push({.name = NameOf(mesh),
                                .capture_us = mesh.stream == WatchStream::kActorMesh ? mesh.capture_us : 0,
                                .mesh = {mesh.mesh.begin(), mesh.mesh.end()},
                                .texture = {mesh.texture.begin(), mesh.texture.end()}});
}

MeshDump::Counts MeshDump::Finish() {
  waiting_.Close();
  if (thread_.joinable()) thread_.join();
  return {.written = written_, .left_out = pushed_out_ + failed_};
}

void MeshDump::RunWrite() {
  while (const auto files = waiting_.Pop()) {
    if (Write(*files)) {
      ++written_;
    } else if (++failed_ == 1) {
      spdlog::error("dump mesh={} reason=\"cannot be written (is the disk full?)\"", files->name);
    }
  }
}

bool MeshDump::Write(const Files& files) const {
  const fs::path stem = folder_ / "mesh" / files.name;
  if (!WriteBytes(stem.string() + ".drc", files.mesh)) return false;
  if (!files.texture.empty() && !WriteBytes(stem.string() + ".jpg", files.texture)) return false;
  if (files.capture_us == 0) return true;
  char line[64];  // a list names a file only after it is complete
  std::snprintf(line, sizeof line, "%lld.%06lld mesh/", static_cast<long long>(files.capture_us / 1'000'000),
                static_cast<long long>(files.capture_us % 1'000'000));
  std::ofstream list(folder_ / "mesh.txt", std::ios::app);
  list << line << files.name << ".drc\n";
  return static_cast<bool>(list.flush());
}

}  // namespace mixstage
