// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/jpeg.h"
#include "server/pipeline/frame.h"
#include "server/pipeline/stage_times.h"
#include "server/segmentation/actor_mesh.h"

namespace mixstage {

enum class MeshFormat {
  kDraco = 1,  // STEM.drc, its texture beside it: STEM.jpg
  kPly,        // binary, a colour at every vertex
  kGlb,        // glTF binary, textured
};
// "drc", "ply", "glb"; fails (kInvalidConfig) on anything else.
Result<MeshFormat> ParseMeshFormat(const std::string& name);

// `process --export mesh`: the actor of each frame as a file in the world's frame.
class MeshExporter {
 public:
  static Result<MeshExporter> Create(const PinholeCamera& color, MeshFormat format);

  // Writes FOLDER/STEM.*; a frame without an actor has no file. The folder exists.
  Status Write(const Frame& frame, const std::filesystem::path& folder, StageTimes& times);

 private:
  MeshExporter(ActorMesher mesher, MeshFormat format) : mesher_(std::move(mesher)), format_(format) {}

  ActorMesher mesher_;
  JpegEncoder jpeg_;
  MeshFormat format_;
  std::vector<std::uint8_t> texture_;
};

}  // namespace mixstage
