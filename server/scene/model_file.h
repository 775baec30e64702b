// SPDX-License-Identifier: Apache-2.0
//
// Model files of people: glTF (.glb, .gltf), OBJ with its .mtl, PLY. Everything in them is checked before it
// is believed: sizes (ModelLimits), offsets, indices, numbers, and that they name only files inside their own
// folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "proto/base/file_bytes.h"
#include "proto/base/result.h"
#include "server/scene/mesh.h"
#include "server/scene/placing.h"

namespace mixstage {

struct LoadedModel {
  Mesh mesh;
  UpAxis up = UpAxis::kY;             // what this kind of file usually calls up
  std::vector<std::string> warnings;  // what was left out, one line each
};

// By the file's extension. Fails with one line: kInvalidConfig for an unknown extension,
// kUnavailable when memory runs out, kBadInput else.
// Where the file is a stranger's, let LoadModelApart (model_process.h) call it.
Result<LoadedModel> LoadModel(const std::filesystem::path& file);

// Either of the two.
using ModelLoader = std::function<Result<LoadedModel>(const std::filesystem::path& file)>;

// Where a name found inside a model leads: a regular file in the model's folder or below it, links resolved.
// Refused: absolute names, "..", schemes ("http:"), and links that lead out of the folder.
Result<std::filesystem::path> ResolveInside(const std::filesystem::path& folder, const std::string& name);

// The importers, for bytes already in memory; folder is where the names inside lead.
Result<LoadedModel> ImportGltf(const std::vector<std::uint8_t>& bytes, const std::filesystem::path& folder);
Result<LoadedModel> ImportObj(const std::vector<std::uint8_t>& bytes, const std::filesystem::path& folder);
Result<LoadedModel> ImportPly(const std::vector<std::uint8_t>& bytes);

// The last step of every importer: normals of length 1, all of Mesh's promises checked; names what is broken.
Status CheckMesh(const Mesh& mesh);

}  // namespace mixstage
