// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/mesh_file.h"

#include <Eigen/Geometry>
#include <bit>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "proto/base/check.h"
#include "proto/base/version.h"

namespace mixstage {
namespace {

static_assert(std::endian::native == std::endian::little, "both kinds of file are little-endian");

template <typename T>
void Append(std::vector<std::uint8_t>& to, const T* values, std::size_t count) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(values);
  to.insert(to.end(), bytes, bytes + count * sizeof(T));
}
void AppendNumber(std::vector<std::uint8_t>& to, std::uint32_t value) { Append(to, &value, 1); }

// Chunks and buffer views begin at multiples of four bytes.
void Pad(std::vector<std::uint8_t>& bytes, std::uint8_t with) {
  while (bytes.size() % 4 != 0) bytes.push_back(with);
}

// The binary chunk and the views of it.
struct Buffer {
  std::vector<std::uint8_t> bytes;
  nlohmann::ordered_json views = nlohmann::ordered_json::array();

  template <typename T>
  std::size_t Add(std::span<const T> values, int target) {
    Pad(bytes, 0);
    nlohmann::ordered_json view = {
        {"buffer", 0}, {"byteOffset", bytes.size()}, {"byteLength", values.size_bytes()}};
    if (target != 0) view["target"] = target;
    views.push_back(std::move(view));
    Append(bytes, values.data(), values.size());
    return views.size() - 1;
  }
};

constexpr int kVertices = 34962, kIndices = 34963;  // GL's ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER
constexpr int kFloat = 5126, kUnsignedInt = 5125;
constexpr int kLinear = 9729, kLinearMipmapLinear = 9987, kClampToEdge = 33071;

}  // namespace

std::vector<std::uint8_t> WriteGlb(const MeshView& mesh, std::span<const std::uint8_t> jpeg) {
  MIX_CHECK(mesh.indices.size() >= 3 && mesh.indices.size() % 3 == 0);
  MIX_CHECK(mesh.uvs.empty() || mesh.uvs.size() == mesh.positions.size());
  using Json = nlohmann::ordered_json;
  Buffer buffer;
  Json accessors = Json::array();
  Eigen::AlignedBox3f box;
  for (const Eigen::Vector3f& p : mesh.positions) box.extend(p);
  const auto numbers = [](const Eigen::Vector3f& p) { return Json::array({p.x(), p.y(), p.z()}); };
  accessors.push_back({{"bufferView", buffer.Add(mesh.positions, kVertices)},
                       {"componentType", kFloat},
                       {"count", mesh.positions.size()},
                       {"type", "VEC3"},
                       {"min", numbers(box.min())},
                       {"max", numbers(box.max())}});
  Json attributes = {{"POSITION", 0}};
  if (!mesh.uvs.empty()) {
    attributes["TEXCOORD_0"] = accessors.size();
    accessors.push_back({{"bufferView", buffer.Add(mesh.uvs, kVertices)},
                         {"componentType", kFloat},
                         {"count", mesh.uvs.size()},
                         {"type", "VEC2"}});
  }
  const std::size_t indices = accessors.size();
  accessors.push_back({{"bufferView", buffer.Add(mesh.indices, kIndices)},
                       {"componentType", kUnsignedInt},
                       {"count", mesh.indices.size()},
                       {"type", "SCALAR"}});
  // The picture holds the light that fell on the surface: another light would be one too many.
  Json material = {{"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}},
                   {"doubleSided", true},
                   {"extensions", {{"KHR_materials_unlit", Json::object()}}}};
  Json gltf = {
      {"asset", {{"version", "2.0"}, {"generator", std::string("MixStage ") + kVersion}}},
      {"extensionsUsed", {"KHR_materials_unlit"}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"mesh", 0}, {"rotation", {-std::sqrt(0.5), 0, 0, std::sqrt(0.5)}}}}},
      {"meshes", {{{"primitives", {{{"attributes", attributes}, {"indices", indices}, {"material", 0}}}}}}}};
  if (!jpeg.empty()) {
    material["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", 0}};
    gltf["images"] = {{{"bufferView", buffer.Add(jpeg, 0)}, {"mimeType", "image/jpeg"}}};
    gltf["samplers"] = {{{"magFilter", kLinear},
                         {"minFilter", kLinearMipmapLinear},
                         {"wrapS", kClampToEdge},
                         {"wrapT", kClampToEdge}}};
    gltf["textures"] = {{{"source", 0}, {"sampler", 0}}};
  }
  gltf["materials"] = Json::array({material});
  gltf["accessors"] = std::move(accessors);
  gltf["bufferViews"] = std::move(buffer.views);
  Pad(buffer.bytes, 0);
  gltf["buffers"] = {{{"byteLength", buffer.bytes.size()}}};

  const std::string text = gltf.dump();
  std::vector<std::uint8_t> json(text.begin(), text.end());
  Pad(json, ' ');
  constexpr std::size_t kHeader = 12, kChunkHeader = 8;
  const std::size_t size = kHeader + kChunkHeader + json.size() + kChunkHeader + buffer.bytes.size();
  MIX_CHECK(size < (std::size_t{1} << 31));
  std::vector<std::uint8_t> file;
  file.reserve(size);
  AppendNumber(file, 0x46546C67);  // "glTF"
  AppendNumber(file, 2);
  AppendNumber(file, static_cast<std::uint32_t>(size));
  AppendNumber(file, static_cast<std::uint32_t>(json.size()));
  AppendNumber(file, 0x4E4F534A);  // "JSON"
  Append(file, json.data(), json.size());
  AppendNumber(file, static_cast<std::uint32_t>(buffer.bytes.size()));
  AppendNumber(file, 0x004E4942);  // "BIN"
  Append(file, buffer.bytes.data(), buffer.bytes.size());
  return file;
}

std::vector<std::uint8_t> WritePly(const MeshView& mesh) {
  MIX_CHECK(mesh.colors.empty() || mesh.colors.size() == mesh.positions.size());
  std::string header =
      "ply\nformat binary_little_endian 1.0\ncomment MixStage, metres, z up\nelement vertex " +
      std::to_string(mesh.positions.size()) + "\nproperty float x\nproperty float y\nproperty float z\n";
  if (!mesh.colors.empty()) header += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  header += "element face " + std::to_string(mesh.indices.size() / 3) +
            "\nproperty list uchar int vertex_indices\nend_header\n";
  std::vector<std::uint8_t> file(header.begin(), header.end());
  for (std::size_t i = 0; i < mesh.positions.size(); ++i) {
    Append(file, mesh.positions[i].data(), 3);
    if (!mesh.colors.empty()) Append(file, mesh.colors[i].data(), 3);
  }
  for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3) {
    file.push_back(3);
    Append(file, &mesh.indices[i], 3);
  }
  return file;
}

}  // namespace mixstage
