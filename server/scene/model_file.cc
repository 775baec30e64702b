// SPDX-License-Identifier: Apache-2.0
#include "server/scene/model_file.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <system_error>

namespace mixstage {
namespace {

namespace fs = std::filesystem;

// A coordinate beyond this is a broken file, and float depth would mean nothing there.
constexpr float kLargestCoordinate = 1e6f;

Result<LoadedModel> Import(const fs::path& file) {
  std::string extension = file.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const bool gltf = extension == ".glb" || extension == ".gltf";
  if (!gltf && extension != ".obj" && extension != ".ply") {
    return Fail(ErrorCode::kInvalidConfig, "is not a .glb, .gltf, .obj or .ply file");
  }
  auto bytes = ReadFileBytes(file, ModelLimits::kFileBytes);
  if (!bytes) return tl::unexpected(bytes.error());
  if (gltf) return ImportGltf(*bytes, file.parent_path());
  if (extension == ".obj") return ImportObj(*bytes, file.parent_path());
  return ImportPly(*bytes);
}

}  // namespace

Result<LoadedModel> LoadModel(const fs::path& file) {
  // Third-party parsers throw, and so does an allocation that a file talked us into: none of it goes further.
  try {
    auto model = Import(file);
    if (!model) return Within(file.string(), model.error());
    if (auto ok = CheckMesh(model->mesh); !ok) return Within(file.string(), ok.error());
    return model;
  } catch (const std::bad_alloc&) {
    return Fail(ErrorCode::kUnavailable, file.string() + ": needs more memory than there is");
  } catch (const std::exception& e) {
    return Fail(ErrorCode::kBadInput, file.string() + ": cannot be read as a model (" + e.what() + ")");
  }
}

Result<fs::path> ResolveInside(const fs::path& folder, const std::string& name) {
  auto refused = [&](const char* why) {
    return Fail(ErrorCode::kBadInput, "names the file '" + name.substr(0, 120) + "', which " + why);
  };
  const fs::path relative(name);
  if (name.empty() || name.size() > 1024 || name.find('\0') != std::string::npos)
    return refused("is no file name");
  if (name.find(':') != std::string::npos || name.find('\\') != std::string::npos || relative.is_absolute()) {
    return refused("is not relative to the model's folder");
  }
  if (std::any_of(relative.begin(), relative.end(), [](const fs::path& step) { return step == ".."; })) {
    return refused("leads out of the model's folder");
  }
  std::error_code error;
  const fs::path root = fs::canonical(folder.empty() ? fs::path(".") : folder, error);
  if (error) return refused("cannot be looked up");
  const fs::path found = fs::canonical(root / relative, error);
  if (error || !fs::is_regular_file(found, error)) return refused("is missing");
  const auto mismatch = std::mismatch(root.begin(), root.end(), found.begin(), found.end());
  if (mismatch.first != root.end()) return refused("leads out of the model's folder");
  return found;
}

Status CheckMesh(const Mesh& mesh) {
  auto bad = [](const std::string& what) { return Fail(ErrorCode::kBadInput, what); };
  if (mesh.indices.empty()) return bad("holds no triangles");
  const std::size_t n = mesh.positions.size();
  if (n > ModelLimits::kVertices)
    return bad("has more than " + std::to_string(ModelLimits::kVertices) + " vertices");
  if (mesh.triangle_count() > ModelLimits::kTriangles) {
    return bad("has more than " + std::to_string(ModelLimits::kTriangles) + " triangles");
  }
  if (mesh.indices.size() % 3 != 0) return bad("its number of indices is no multiple of 3");
  for (const std::uint32_t i : mesh.indices) {
    if (i >= n)
      return bad("index " + std::to_string(i) + " is beyond its " + std::to_string(n) + " vertices");
  }
  for (const Eigen::Vector3f& p : mesh.positions) {
    if (!(p.cwiseAbs().maxCoeff() <= kLargestCoordinate) || !p.allFinite()) {
      return bad("has a position that is not a number within 1e6");
    }
  }
  if (mesh.normals.size() != n) return bad("has not one normal a vertex");
  for (const Eigen::Vector3f& normal : mesh.normals) {
    if (!(std::abs(normal.norm() - 1.0f) < 1e-3f)) return bad("has a normal that is not of length 1");
  }
  if (!mesh.uvs.empty() && mesh.uvs.size() != n) return bad("has not one texture coordinate a vertex");
  if (!mesh.colors.empty() && mesh.colors.size() != n) return bad("has not one colour a vertex");
  for (const Eigen::Vector2f& uv : mesh.uvs) {
    if (!uv.allFinite() || uv.cwiseAbs().maxCoeff() > 1e6f)
      return bad("has a texture coordinate that is not a number within 1e6");
  }
  for (const Eigen::Vector3f& color : mesh.colors) {
    if (!color.allFinite()) return bad("has a vertex colour that is not a number");
  }
  if (mesh.motion != nullptr) {
    if (mesh.motion->clips.empty()) return bad("moves without an animation");
    if (auto ok = CheckMotion(*mesh.motion, n); !ok) return ok;
  }
  std::size_t covered = 0;
  for (const MeshPart& part : mesh.parts) {
    if (part.material < 0 || static_cast<std::size_t>(part.material) >= mesh.materials.size()) {
      return bad("has a part without material");
    }
    if (part.first_index != covered || part.index_count % 3 != 0)
      return bad("its parts do not cover its triangles");
    covered += part.index_count;
  }
  if (covered != mesh.indices.size()) return bad("its parts do not cover its triangles");
  for (const Material& material : mesh.materials) {
    if (material.texture >= static_cast<int>(mesh.textures.size()))
      return bad("has a material without its texture");
  }
  return {};
}

}  // namespace mixstage
