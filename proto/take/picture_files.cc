// SPDX-License-Identifier: Apache-2.0
#include "proto/take/picture_files.h"

#include <algorithm>
#include <array>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <span>

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxSide = 8192;
constexpr std::int64_t kMaxPixels = 34'000'000;

// Width and height of a PNG's IHDR, which has to be its first chunk: a decoder that skips another one in
// front of it would make a picture of another size.
std::optional<PictureSize> PngSize(std::span<const std::uint8_t> bytes) {
  constexpr std::array<std::uint8_t, 16> kSignature = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n',
                                                       0,    0,   0,   13,  'I',  'H',  'D',  'R'};
  if (bytes.size() < 33 || !std::equal(kSignature.begin(), kSignature.end(), bytes.begin()))
    return std::nullopt;
  auto big_endian = [&](std::size_t at) {
    return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
           std::uint32_t{bytes[at + 2]} << 8 | bytes[at + 3];
  };
  const std::uint32_t width = big_endian(16);
  const std::uint32_t height = big_endian(20);
  if (width > 0x7FFFFFFF || height > 0x7FFFFFFF) return std::nullopt;
  return PictureSize{static_cast<int>(width), static_cast<int>(height)};
}

Result<PictureSize> CheckedPngSize(std::span<const std::uint8_t> bytes) {
  const auto size = PngSize(bytes);
  if (!size) return Fail(ErrorCode::kBadInput, "is neither JPEG nor PNG");
  if (size->width < 1 || size->height < 1 || size->width > kMaxSide || size->height > kMaxSide ||
      std::int64_t{size->width} * size->height > kMaxPixels) {
    return Fail(ErrorCode::kBadInput, "is of " + std::to_string(size->width) + " x " +
                                          std::to_string(size->height) + " pixels, over the limit");
  }
  return *size;
}

Result<cv::Mat> DecodePng(const std::vector<std::uint8_t>& bytes, int flags) {
  if (auto size = CheckedPngSize(bytes); !size) return tl::unexpected(size.error());
  cv::Mat picture;
  try {
    picture = cv::imdecode(bytes, flags);
  } catch (const cv::Exception& e) {
    return Fail(ErrorCode::kBadInput, std::string("damaged PNG: ") + e.err);
  }
  if (picture.empty()) return Fail(ErrorCode::kBadInput, "damaged PNG");
  return picture;
}

Result<cv::Mat> LoadPng(const fs::path& file, int type, const char* what) {
  auto bytes = ReadFileBytes(file, kMaxPictureFileBytes);
  if (!bytes) return Within(file.string(), bytes.error());
  auto decoded = DecodePng(*bytes, cv::IMREAD_UNCHANGED);
  if (!decoded) return Within(file.string(), decoded.error());
  if (decoded->type() != type) return Fail(ErrorCode::kBadInput, file.string() + ": is not " + what);
  return decoded;
}

}  // namespace

bool IsJpeg(const std::vector<std::uint8_t>& bytes) {
  return bytes.size() > 2 && bytes[0] == 0xFF && bytes[1] == 0xD8;
}

Result<PictureSize> ReadColorSize(const fs::path& file) {
  auto bytes = ReadFileBytes(file, kMaxPictureFileBytes);
  if (!bytes) return Within(file.string(), bytes.error());
  if (IsJpeg(*bytes)) {
    auto header = JpegDecoder().ReadHeader(*bytes);
    if (!header) return Within(file.string(), header.error());
    return PictureSize{header->width, header->height};
  }
  auto size = CheckedPngSize(*bytes);
  if (!size) return Within(file.string(), size.error());
  return size;
}

Status LoadColor(const fs::path& file, JpegDecoder& decoder, YuvImage& image) {
  auto bytes = ReadFileBytes(file, kMaxPictureFileBytes);
  if (!bytes) return Within(file.string(), bytes.error());
  if (IsJpeg(*bytes)) {
    if (auto ok = decoder.Decode(*bytes, image); !ok) return Within(file.string(), ok.error());
    return {};
  }
  auto picture = DecodePng(*bytes, cv::IMREAD_COLOR);
  if (!picture) return Within(file.string(), picture.error());
  image = FromBgr(*picture, ChromaLayout::k444);
  return {};
}

Status LoadDepth16(const fs::path& file, cv::Mat1w& picture) {
  auto decoded = LoadPng(file, CV_16UC1, "a 16-bit grey PNG");
  if (!decoded) return tl::unexpected(decoded.error());
  picture = *decoded;
  return {};
}

Status LoadBgra(const fs::path& file, cv::Mat4b& picture) {
  auto decoded = LoadPng(file, CV_8UC4, "an 8-bit PNG with alpha");
  if (!decoded) return tl::unexpected(decoded.error());
  picture = *decoded;
  return {};
}

}  // namespace mixstage
