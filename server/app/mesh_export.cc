// SPDX-License-Identifier: Apache-2.0
#include "server/app/mesh_export.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <span>

#include "server/delivery/draco_mesh.h"
#include "server/delivery/mesh_file.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr int kJpegQuality = 90;
// Files are worked on: finer than what viewers get.
constexpr DracoPrecision kPrecision = {.position_bits = 14, .uv_bits = 12};

Status WriteFile(const fs::path& file, std::span<const std::uint8_t> bytes) {
  std::ofstream out(file, std::ios::binary);
  out.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  if (!out.flush())
    return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written (is the disk full?)");
  return {};
}

// Of the nearest pixel.
std::vector<std::array<std::uint8_t, 3>> ColorsOf(const PictureMesh& mesh, const YuvImage& crop) {
  std::vector<std::array<std::uint8_t, 3>> colors;
  colors.reserve(mesh.uvs.size());
  for (const Eigen::Vector2f& uv : mesh.uvs) {
    const int x =
        std::clamp(static_cast<int>(uv.x() * static_cast<float>(crop.width())), 0, crop.width() - 1);
    const int y =
        std::clamp(static_cast<int>(uv.y() * static_cast<float>(crop.height())), 0, crop.height() - 1);
    const int chroma_x = x >> ChromaShiftX(crop.layout), chroma_y = y >> ChromaShiftY(crop.layout);
    const Rgb8 rgb = YcbcrToRgb(crop.y(y, x), crop.cb(chroma_y, chroma_x), crop.cr(chroma_y, chroma_x));
    colors.push_back({rgb.r, rgb.g, rgb.b});
  }
  return colors;
}

}  // namespace

Result<MeshFormat> ParseMeshFormat(const std::string& name) {
  if (name == "drc") return MeshFormat::kDraco;
  if (name == "ply") return MeshFormat::kPly;
  if (name == "glb") return MeshFormat::kGlb;
  return Fail(ErrorCode::kInvalidConfig, "--mesh-format " + name + " is none of drc, ply, glb");
}

Result<MeshExporter> MeshExporter::Create(const PinholeCamera& color, MeshFormat format) {
  auto mesher = ActorMesher::Create({}, color);
  if (!mesher) return tl::unexpected(mesher.error());
  return MeshExporter(std::move(*mesher), format);
}

Status MeshExporter::Write(const Frame& frame, const fs::path& folder, StageTimes& times) {
  const PictureMesh* mesh = nullptr;
  {
    const StageTimer timer(times, "actor_mesh");
    mesh = &mesher_.Run(View(frame.alpha), View(frame.actor_depth_m), frame.T_world_view);
  }
  if (mesh->empty()) return {};
  MeshView view{.positions = mesh->positions, .uvs = mesh->uvs, .indices = mesh->indices};
  const YuvImage crop = Crop(frame.Real(), mesh->crop);
  const fs::path file = folder / frame.captured->stem;
  const auto with = [&file](const char* extension) { return fs::path(file.string() + extension); };
  if (format_ == MeshFormat::kPly) {
    const auto colors = ColorsOf(*mesh, crop);
    view.colors = colors;
    return WriteFile(with(".ply"), WritePly(view));
  }
  const StageTimer timer(times, "encode_mesh");
  if (auto ok = jpeg_.Encode(crop, kJpegQuality, texture_); !ok) return ok;
  if (format_ == MeshFormat::kGlb) return WriteFile(with(".glb"), WriteGlb(view, texture_));
  const auto draco = EncodeDraco(view, kPrecision);
  if (!draco) return Within(with(".drc").string(), draco.error());
  if (auto ok = WriteFile(with(".jpg"), texture_); !ok) return ok;
  return WriteFile(with(".drc"), *draco);
}

}  // namespace mixstage
