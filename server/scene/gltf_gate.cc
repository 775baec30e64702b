// SPDX-License-Identifier: Apache-2.0
#include "server/scene/gltf_gate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string_view>

#include "server/scene/mesh.h"

namespace mixstage {
namespace {

using Json = nlohmann::json;

// Those whose absence of support would change where a vertex lies; materials' extensions may be left out.
constexpr std::array<std::string_view, 6> kKnownExtensions = {
    "KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_unlit",
    "KHR_lights_punctual",   "KHR_materials_ior",     "KHR_materials_specular"};
constexpr std::uint32_t kChunkJson = 0x4E4F534A;  // "JSON"

auto Bad(const std::string& what) { return Fail(ErrorCode::kBadInput, what); }

std::uint32_t LittleEndian32(const std::vector<std::uint8_t>& b, std::size_t at) {
  return static_cast<std::uint32_t>(b[at]) | static_cast<std::uint32_t>(b[at + 1]) << 8 |
         static_cast<std::uint32_t>(b[at + 2]) << 16 | static_cast<std::uint32_t>(b[at + 3]) << 24;
}

// The JSON chunk of a GLB (header 12 bytes: magic, version, length; then chunks of length, kind, payload).
Result<std::string_view> JsonChunk(const std::vector<std::uint8_t>& b) {
  if (b.size() < 12) return Bad("is cut inside its GLB header");
  if (const std::uint32_t version = LittleEndian32(b, 4); version != 2) {
    return Bad("is glTF " + std::to_string(version) + ", only 2 is known");
  }
  if (LittleEndian32(b, 8) > b.size()) return Bad("is shorter than its GLB header says");
  if (b.size() < 20) return Bad("has no JSON chunk");
  const std::uint32_t length = LittleEndian32(b, 12);
  if (LittleEndian32(b, 16) != kChunkJson) return Bad("its first GLB chunk is not JSON");
  if (length > b.size() - 20) return Bad("its JSON chunk is longer than the file");
  return std::string_view(reinterpret_cast<const char*>(b.data()) + 20, length);
}

// Bounds what the tree of this JSON takes in memory and on the stack before anyone builds it.
Status CheckJsonShape(std::string_view json) {
  if (json.size() > ModelLimits::kJsonBytes)
    return Bad("its JSON is over 64 MB: put the buffers into a .glb");
  int depth = 0;
  std::size_t tokens = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
      continue;
    }
    if (c == '"') in_string = true;
    if (c == '{' || c == '[') ++depth;
    if (c == '}' || c == ']') --depth;
    if (c == '{' || c == '[' || c == ',' || c == ':') ++tokens;
    if (depth > ModelLimits::kJsonDepth) return Bad("its JSON is nested deeper than 64");
    if (tokens > ModelLimits::kJsonTokens) return Bad("its JSON has more than 2 million values");
  }
  return {};
}

Status CheckExtensions(const Json& root) {
  if (!root.contains("extensionsRequired")) return {};
  const Json& required = root.at("extensionsRequired");
  if (!required.is_array()) return Bad("extensionsRequired is not a list");
  for (const Json& name : required) {
    if (!name.is_string()) return Bad("extensionsRequired has an entry that is no name");
    const auto& text = name.get_ref<const std::string&>();
    if (std::find(kKnownExtensions.begin(), kKnownExtensions.end(), text) == kKnownExtensions.end()) {
      return Bad("needs the extension " + text.substr(0, 80) + ", which is not supported: export without it");
    }
  }
  return {};
}

// tinygltf copies the binary chunk once a buffer and multiplies nothing by itself; the sum is bounded here.
Status CheckBuffers(const Json& root, GltfContainer container) {
  if (!root.contains("buffers")) return {};
  if (!root.at("buffers").is_array()) return Bad("buffers is not a list");
  double total = 0;
  for (std::size_t i = 0; i < root.at("buffers").size(); ++i) {
    const Json& buffer = root.at("buffers")[i];
    const std::string place = "buffers[" + std::to_string(i) + "]";
    if (!buffer.is_object() || !buffer.contains("byteLength") ||
        !buffer.at("byteLength").is_number_unsigned() || buffer.at("byteLength").get<double>() < 1) {
      return Bad(place + ".byteLength is not a positive whole number");
    }
    total += buffer.at("byteLength").get<double>();
    if (total > static_cast<double>(ModelLimits::kTotalBytes))
      return Bad(place + ": its buffers are over 512 MB");
    if (!buffer.contains("uri") && (container == GltfContainer::kText || i > 0))
      return Bad(place + " has no uri");
    if (buffer.contains("uri") && !buffer.at("uri").is_string()) return Bad(place + ".uri is not a text");
  }
  return {};
}

Status CheckLists(const Json& root) {
  for (const char* key :
       {"accessors", "bufferViews", "images", "materials", "meshes", "nodes", "scenes", "textures"}) {
    if (!root.contains(key)) continue;
    if (!root.at(key).is_array()) return Bad(std::string(key) + " is not a list");
    if (root.at(key).size() > ModelLimits::kParts)
      return Bad(std::string(key) + " has more than 65536 entries");
    for (const Json& entry : root.at(key)) {
      if (!entry.is_object()) return Bad(std::string(key) + " has an entry that is no object");
    }
  }
  return {};
}

}  // namespace

Result<GltfContainer> CheckGltf(const std::vector<std::uint8_t>& bytes) {
  if (bytes.size() < 4) return Bad("is empty or cut inside its first bytes");
  const GltfContainer container =
      std::memcmp(bytes.data(), "glTF", 4) == 0 ? GltfContainer::kBinary : GltfContainer::kText;
  std::string_view json(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  if (container == GltfContainer::kBinary) {
    auto chunk = JsonChunk(bytes);
    if (!chunk) return tl::unexpected(chunk.error());
    json = *chunk;
  }
  if (auto ok = CheckJsonShape(json); !ok) return tl::unexpected(ok.error());
  const Json root = Json::parse(json, nullptr, /*allow_exceptions=*/false);
  if (root.is_discarded() || !root.is_object()) return Bad("holds no JSON object");
  for (const Status& step : {CheckExtensions(root), CheckBuffers(root, container), CheckLists(root)}) {
    if (!step) return tl::unexpected(step.error());
  }
  return container;
}

}  // namespace mixstage
