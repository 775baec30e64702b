// SPDX-License-Identifier: Apache-2.0
#include "server/app/room_file.h"

#include <array>
#include <cstring>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <unordered_map>

#include "proto/base/check.h"
#include "server/delivery/mesh_file.h"
#include "server/scene/model_process.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr const char* kRoomFile = "room.glb";
constexpr int kJpegQuality = 95;

using Corner = std::array<float, 5>;  // position, uv
struct HashCorner {
  std::size_t operator()(const Corner& corner) const {
    std::uint64_t hash = 0;
    for (const float value : corner) {
      std::uint32_t bits = 0;
      std::memcpy(&bits, &value, sizeof bits);
      hash = (hash ^ bits) * 0x9E3779B97F4A7C15u;
      hash ^= hash >> 29;
    }
    return hash;
  }
};

// An importer gives every triangle its own corners where a file has no normals: joined again, a third to a
// sixth of them is left to project.
void AddTriangles(const Mesh& mesh, RoomModel& room) {
  std::unordered_map<Corner, std::uint32_t, HashCorner> numbers;
  for (const std::uint32_t index : mesh.indices) {
    const Eigen::Vector3f& p = mesh.positions[index];
    const Eigen::Vector2f& uv = mesh.uvs[index];
    // glTF's y up to the world's z up.
    const auto [found, added] = numbers.try_emplace(Corner{p.x(), -p.z(), p.y(), uv.x(), uv.y()},
                                                    static_cast<std::uint32_t>(room.positions.size()));
    if (added) {
      room.positions.emplace_back(p.x(), -p.z(), p.y());
      room.uvs.push_back(uv);
    }
    room.indices.push_back(found->second);
  }
}

}  // namespace

Status WriteRoom(const fs::path& folder, const RoomModel& room) {
  MIX_CHECK(room.Validate().has_value());
  const fs::path file = folder / kRoomFile;
  std::vector<std::uint8_t> jpeg;
  bool encoded = false;
  try {
    encoded = cv::imencode(".jpg", room.texture_bgr, jpeg, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
  } catch (const cv::Exception&) {
  }
  if (!encoded) return Fail(ErrorCode::kInternal, file.string() + ": its texture cannot be encoded");
  const std::vector<std::uint8_t> bytes =
      WriteGlb({.positions = room.positions, .uvs = room.uvs, .indices = room.indices}, jpeg);
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!out.flush())
    return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written (is the disk full?)");
  return {};
}

Result<RoomModel> ReadRoom(const fs::path& folder) {
  const fs::path file = folder / kRoomFile;
  auto loaded = LoadModelApart(file);
  if (!loaded) return tl::unexpected(loaded.error());
  const Mesh& mesh = loaded->mesh;
  auto bad = [&](const char* what) { return Fail(ErrorCode::kBadInput, file.string() + ": " + what); };
  if (mesh.textures.size() != 1 || mesh.uvs.empty()) return bad("is not a surface with one texture");
  for (const MeshPart& part : mesh.parts) {
    if (mesh.materials[static_cast<std::size_t>(part.material)].texture != 0)
      return bad("has triangles without the texture");
  }
  RoomModel room;
  AddTriangles(mesh, room);
  cv::cvtColor(mesh.textures[0].rgba, room.texture_bgr, cv::COLOR_RGBA2BGR);
  if (auto ok = room.Validate(); !ok) return Within(file.string(), ok.error());
  return room;
}

}  // namespace mixstage
