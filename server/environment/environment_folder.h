// SPDX-License-Identifier: Apache-2.0
//
// The environment folder that a scan writes and a show reads (SPEC.md 9): environment.json and the panorama.
// Its third part, the textured surface room.glb, is read and written by server/app/room_file.h, where model
// files are.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>

#include "proto/base/result.h"
#include "server/environment/environment.h"

namespace mixstage {

struct PanoramaPictures {
  cv::Mat4b color_bgra;  // [height x width] sRGB, vignetting and exposure taken out; A = 0: never seen
  cv::Mat1w range_mm;    // [height x width] length along the ray from the panorama's centre; 0 = not known
};

// The room's surface as the scan leaves it: triangles of the world frame, counter-clockwise seen from inside
// the room, cut where the depth steps; what was never seen has none.
struct RoomModel {
  std::vector<Eigen::Vector3f> positions;
  std::vector<Eigen::Vector2f> uvs;    // 0..1 on texture, v down; one a position
  std::vector<std::uint32_t> indices;  // three a triangle
  cv::Mat3b texture_bgr;               // sRGB, vignetting and exposure taken out; at most 8192 px a side

  [[nodiscard]] std::size_t triangle_count() const { return indices.size() / 3; }
  // Fails (kBadInput) unless sizes and indices fit, all numbers are finite and there is a triangle and a
  // texture.
  [[nodiscard]] Status Validate() const;
};

// A scan as its folder has it.
struct RoomScan {
  Environment environment;
  PanoramaPictures pictures;
  RoomModel room;
};

// Makes the folder where it is missing. Fails with kUnavailable (disk); sizes that differ from the panorama's
// are our bug.
Status WriteEnvironment(const std::filesystem::path& folder, const Environment& environment);
Status WritePanorama(const std::filesystem::path& folder, const Panorama& panorama,
                     const PanoramaPictures& pictures);

// environment.json alone. Fails with kBadInput: file, field and reason.
Result<ParsedEnvironment> ReadEnvironment(const std::filesystem::path& folder);
// Fails with kBadInput where a picture is missing, of another kind or not of the panorama's size.
Result<PanoramaPictures> ReadPanorama(const std::filesystem::path& folder, const Panorama& panorama);

}  // namespace mixstage
