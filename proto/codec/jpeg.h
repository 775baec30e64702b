// SPDX-License-Identifier: Apache-2.0
//
// The gate that every JPEG from the network or a file passes (libjpeg-turbo behind it): sizes are read and
// capped before a plane is allocated, damaged data is an error, never a half-grey picture.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"

namespace mixstage {

struct JpegLimits {
  int max_width_px = 8192;
  int max_height_px = 8192;
  std::int64_t max_pixels = 34'000'000;  // 8192 x 4096
  std::size_t max_bytes = std::size_t{8} << 20;
};

// Not for two threads at once; one decoder per thread.
class JpegDecoder {
 public:
  explicit JpegDecoder(const JpegLimits& limits = {});
  ~JpegDecoder();
  JpegDecoder(JpegDecoder&&) noexcept;
  JpegDecoder& operator=(JpegDecoder&&) noexcept;

  struct Header {
    int width = 0, height = 0;  // px
  };
  // Size of the picture, checked against the limits; decodes nothing.
  Result<Header> ReadHeader(std::span<const std::uint8_t> jpeg);

  // Planes of the picture. 4:4:4, 4:2:2 and 4:2:0 stay as they are; grey, 4:4:0 and 4:1:1 become 4:4:4 or
  // 4:2:0. `image` is (re)allocated as needed. Fails on any damage that libjpeg-turbo notices, also what it
  // could repair: a picture that is half old is a silent wrong answer to the key. Also fails on more than 500
  // progressive scans, which cost seconds and show nothing.
  Status Decode(std::span<const std::uint8_t> jpeg, YuvImage& image);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

// Encodes planes as they are, without a detour over RGB. quality 1..100.
class JpegEncoder {
 public:
  JpegEncoder();
  ~JpegEncoder();
  JpegEncoder(JpegEncoder&&) noexcept;
  JpegEncoder& operator=(JpegEncoder&&) noexcept;

  Status Encode(const YuvImage& image, int quality, std::vector<std::uint8_t>& jpeg);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace mixstage
