// SPDX-License-Identifier: Apache-2.0
//
// Picture files behind a gate: the size in the header is checked before anything is allocated.
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/file_bytes.h"
#include "proto/base/result.h"
#include "proto/codec/jpeg.h"
#include "proto/codec/yuv_image.h"

namespace mixstage {

struct PictureSize {
  int width = 0, height = 0;  // px
};

inline constexpr std::uintmax_t kMaxPictureFileBytes = std::uintmax_t{64} << 20;

// All errors name the file.
[[nodiscard]] bool IsJpeg(const std::vector<std::uint8_t>& bytes);

// JPEG or PNG.
Result<PictureSize> ReadColorSize(const std::filesystem::path& file);
// JPEG planes as they are; PNG becomes 4:4:4. `decoder` is the calling thread's.
Status LoadColor(const std::filesystem::path& file, JpegDecoder& decoder, YuvImage& image);
// 16-bit grey PNG.
Status LoadDepth16(const std::filesystem::path& file, cv::Mat1w& picture);
// 8-bit PNG with alpha.
Status LoadBgra(const std::filesystem::path& file, cv::Mat4b& picture);

}  // namespace mixstage
