// SPDX-License-Identifier: Apache-2.0
#include "server/scene/texture_file.h"

#include <algorithm>
#include <array>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "server/scene/mesh.h"

namespace mixstage {
namespace {

int BigEndian16(std::span<const std::uint8_t> b, std::size_t at) { return b[at] << 8 | b[at + 1]; }
std::int64_t BigEndian32(std::span<const std::uint8_t> b, std::size_t at) {
  return static_cast<std::int64_t>(BigEndian16(b, at)) << 16 | BigEndian16(b, at + 2);
}

// The first start-of-frame marker of a JPEG; 0 x 0 when there is none.
cv::Size JpegSize(std::span<const std::uint8_t> b) {
  std::size_t at = 2;
  while (at + 9 < b.size()) {
    const int marker = b[at + 1];
    // Behind anything but a marker the decoder would search on by itself, and find another frame than we do.
    if (b[at] != 0xFF || marker == 0) return {};
    if (marker == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    const bool frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame) return {BigEndian16(b, at + 7), BigEndian16(b, at + 5)};
    if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8)) {
      at += 2;
      continue;
    }
    at += 2 + static_cast<std::size_t>(BigEndian16(b, at + 2));
  }
  return {};
}

}  // namespace

Result<cv::Size> PictureSize(std::span<const std::uint8_t> b) {
  // The signature and the head of the first chunk, which has to be IHDR.
  constexpr std::array<std::uint8_t, 16> kPng = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n',
                                                 0,    0,   0,   13,  'I',  'H',  'D',  'R'};
  std::int64_t width = 0;
  std::int64_t height = 0;
  if (b.size() >= 24 && std::equal(kPng.begin(), kPng.end(), b.begin())) {
    width = BigEndian32(b, 16);
    height = BigEndian32(b, 20);
  } else if (b.size() >= 4 && b[0] == 0xFF && b[1] == 0xD8) {
    const cv::Size size = JpegSize(b);
    width = size.width;
    height = size.height;
  } else {
    return Fail(ErrorCode::kBadInput, "is neither PNG nor JPEG");
  }
  if (width < 1 || height < 1 || width > ModelLimits::kTextureSide || height > ModelLimits::kTextureSide) {
    return Fail(ErrorCode::kBadInput, "is " + std::to_string(width) + " x " + std::to_string(height) +
                                          ", outside 1..8192 px a side");
  }
  return cv::Size(static_cast<int>(width), static_cast<int>(height));
}

Result<cv::Mat4b> DecodeTexture(std::span<const std::uint8_t> bytes, std::size_t& remaining_pixels) {
  auto size = PictureSize(bytes);
  if (!size) return tl::unexpected(size.error());
  const auto pixels = static_cast<std::size_t>(size->area());
  if (pixels > remaining_pixels) {
    return Fail(ErrorCode::kBadInput, "would take the model's textures over " +
                                          std::to_string(ModelLimits::kTexturePixels) + " pixels");
  }
  cv::Mat decoded;
  try {
    const cv::Mat encoded(1, static_cast<int>(bytes.size()), CV_8U, const_cast<std::uint8_t*>(bytes.data()));
    decoded = cv::imdecode(encoded, cv::IMREAD_UNCHANGED);
    if (!decoded.empty() && decoded.depth() == CV_16U) decoded.convertTo(decoded, CV_8U, 1.0 / 257.0);
    if (decoded.empty() || decoded.depth() != CV_8U || decoded.size() != *size) {
      return Fail(ErrorCode::kBadInput, "is a damaged picture");
    }
    cv::Mat4b rgba;
    const int channels = decoded.channels();
    if (channels != 1 && channels != 3 && channels != 4)
      return Fail(ErrorCode::kBadInput, "has an unknown pixel format");
    cv::cvtColor(decoded, rgba,
                 channels == 1   ? cv::COLOR_GRAY2RGBA
                 : channels == 3 ? cv::COLOR_BGR2RGBA
                                 : cv::COLOR_BGRA2RGBA);
    remaining_pixels -= pixels;
    return rgba;
  } catch (const cv::Exception&) {
    return Fail(ErrorCode::kBadInput, "is a damaged picture");
  }
}

}  // namespace mixstage
