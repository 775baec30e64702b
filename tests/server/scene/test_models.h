// SPDX-License-Identifier: Apache-2.0
//
// Small model files written by the tests themselves: into a folder that goes when the test ends, or in
// memory.
#pragma once

#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace mixstage::test {

class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "mixstage_test_XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  std::filesystem::path Write(const std::string& name, const std::string& content) const {
    std::ofstream(path_ / name, std::ios::binary) << content;
    return path_ / name;
  }

 private:
  std::filesystem::path path_;
};

inline void AppendU32(std::string& bytes, std::size_t value) {
  const auto v = static_cast<std::uint32_t>(value);
  bytes.append(reinterpret_cast<const char*>(&v), sizeof v);
}

template <typename T>
std::string BytesOf(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

// A GLB of a JSON text and a binary chunk (padded as the format asks).
inline std::string Glb(std::string json, std::string binary) {
  json.resize((json.size() + 3) / 4 * 4, ' ');
  binary.resize((binary.size() + 3) / 4 * 4, '\0');
  std::string glb = "glTF";
  AppendU32(glb, 2);
  AppendU32(glb, 12 + 8 + json.size() + (binary.empty() ? 0 : 8 + binary.size()));
  AppendU32(glb, json.size());
  glb += "JSON" + json;
  if (!binary.empty()) {
    AppendU32(glb, binary.size());
    glb += std::string("BIN\0", 4) + binary;
  }
  return glb;
}

// One triangle (0,0,0) (1,0,0) (0,1,0) with normals +z; node: the JSON members of its node beside "mesh";
// extra: further members of the root, each with a comma in front.
inline std::string TriangleJson(const std::string& node = "", const std::string& extra = "") {
  return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0)" + node +
         R"(}],"meshes":[{"primitives":[{"attributes":{"POSITION":0,"NORMAL":1},"indices":2}]}],)"
         R"("buffers":[{"byteLength":78}],"bufferViews":[{"buffer":0,"byteLength":36},)"
         R"({"buffer":0,"byteOffset":36,"byteLength":36},{"buffer":0,"byteOffset":72,"byteLength":6}],)"
         R"("accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"},)"
         R"({"bufferView":1,"componentType":5126,"count":3,"type":"VEC3"},)"
         R"({"bufferView":2,"componentType":5123,"count":3,"type":"SCALAR"}])" +
         extra + "}";
}
inline std::string TriangleBinary() {
  return BytesOf<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1}) +
         BytesOf<std::uint16_t>({0, 1, 2});
}

// text with the first `from` replaced; the test is void if it is not there.
inline std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  if (at == std::string::npos) std::abort();
  return text.replace(at, from.size(), to);
}

// The triangle on a node at (1, 0, 0), moved by a track of two keys, at 0 s and 2 s.
inline std::string MovingTriangle(const std::string& path, const std::vector<float>& values,
                                  const std::string& interpolation = "LINEAR") {
  const std::string binary =
      TriangleBinary() + std::string(2, '\0') + BytesOf<float>({0, 2}) + BytesOf(values);
  const std::size_t bytes = values.size() * sizeof(float);
  const bool turns = path == "rotation";
  const std::size_t a_key = (turns ? 4u : 3u);
  std::string json = TriangleJson(
      R"(,"translation":[1,0,0])",
      R"(,"animations":[{"name":"go","channels":[{"sampler":0,"target":{"node":0,"path":")" + path +
          R"("}}],"samplers":[{"input":3,"output":4,"interpolation":")" + interpolation + R"("}]}])");
  json = Replaced(
      json, R"("byteLength":6}])",
      R"("byteLength":6},{"buffer":0,"byteOffset":80,"byteLength":8},{"buffer":0,"byteOffset":88,"byteLength":)" +
          std::to_string(bytes) + "}]");
  json = Replaced(
      json, R"("type":"SCALAR"}])",
      R"("type":"SCALAR"},{"bufferView":3,"componentType":5126,"count":2,"type":"SCALAR"},{"bufferView":4,"componentType":5126,"count":)" +
          std::to_string(values.size() / a_key) + R"(,"type":")" + (turns ? "VEC4" : "VEC3") + R"("}])");
  return Glb(Replaced(json, R"("byteLength":78)", R"("byteLength":)" + std::to_string(88 + bytes)), binary);
}

}  // namespace mixstage::test
