// SPDX-License-Identifier: Apache-2.0
#include "server/environment/environment_folder.h"

#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "proto/base/check.h"
#include "proto/base/file_bytes.h"
#include "proto/take/picture_files.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMostJsonBytes = 32 << 20;
constexpr const char* kJson = "environment.json";
constexpr const char* kColor = "panorama_color.png";
constexpr const char* kDepth = "panorama_depth.png";

auto NotWritten(const fs::path& file) {
  return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written (is the disk full?)");
}

Status Save(const fs::path& file, const cv::Mat& picture) {
  bool written = false;
  try {
    written = cv::imwrite(file.string(), picture, {cv::IMWRITE_PNG_COMPRESSION, 1});
  } catch (const cv::Exception&) {
  }
  if (!written) return NotWritten(file);
  return {};
}

Status CheckSize(const fs::path& file, cv::Size size, const Panorama& panorama) {
  if (size == cv::Size(panorama.width, panorama.height)) return {};
  return Fail(ErrorCode::kBadInput, file.string() + ": is " + std::to_string(size.width) + " x " +
                                        std::to_string(size.height) + " px, not environment.json's " +
                                        std::to_string(panorama.width) + " x " +
                                        std::to_string(panorama.height));
}

}  // namespace

Status RoomModel::Validate() const {
  auto bad = [](const char* what) { return Fail(ErrorCode::kBadInput, what); };
  if (indices.empty() || indices.size() % 3 != 0) return bad("has no whole triangles");
  if (uvs.size() != positions.size()) return bad("has not one texture coordinate a vertex");
  if (texture_bgr.empty() || texture_bgr.cols > Panorama::kMostSide || texture_bgr.rows > Panorama::kMostSide)
    return bad("has no texture of 1..8192 px a side");
  for (const std::uint32_t index : indices) {
    if (index >= positions.size()) return bad("has a triangle whose vertex does not exist");
  }
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!positions[i].allFinite() || positions[i].cwiseAbs().maxCoeff() > 1e4f)
      return bad("has a vertex that is not within 10 km");
    if (!uvs[i].allFinite() || uvs[i].minCoeff() < -1e-3f || uvs[i].maxCoeff() > 1.001f)
      return bad("has a texture coordinate outside 0..1");
  }
  return {};
}

Status WriteEnvironment(const fs::path& folder, const Environment& environment) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Fail(ErrorCode::kUnavailable, folder.string() + ": cannot be made: " + error.message());
  std::ofstream file(folder / kJson);
  if (!(file << FormatEnvironment(environment)) || !file.flush()) return NotWritten(folder / kJson);
  return {};
}

Status WritePanorama(const fs::path& folder, const Panorama& panorama, const PanoramaPictures& pictures) {
  const cv::Size size(panorama.width, panorama.height);
  MIX_CHECK(pictures.color_bgra.size() == size && pictures.range_mm.size() == size);
  if (auto ok = Save(folder / kColor, pictures.color_bgra); !ok) return ok;
  return Save(folder / kDepth, pictures.range_mm);
}

Result<ParsedEnvironment> ReadEnvironment(const fs::path& folder) {
  const fs::path file = folder / kJson;
  auto bytes = ReadFileBytes(file, kMostJsonBytes);
  if (!bytes) return Within(file.string(), bytes.error());
  auto parsed = ParseEnvironment(std::string(bytes->begin(), bytes->end()));
  if (!parsed) return Within(file.string(), parsed.error());
  return parsed;
}

Result<PanoramaPictures> ReadPanorama(const fs::path& folder, const Panorama& panorama) {
  PanoramaPictures pictures;
  for (const Status& ok : {LoadBgra(folder / kColor, pictures.color_bgra),
                           CheckSize(folder / kColor, pictures.color_bgra.size(), panorama),
                           LoadDepth16(folder / kDepth, pictures.range_mm),
                           CheckSize(folder / kDepth, pictures.range_mm.size(), panorama)}) {
    if (!ok) return tl::unexpected(ok.error());
  }
  return pictures;
}

}  // namespace mixstage
