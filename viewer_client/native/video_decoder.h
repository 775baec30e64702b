// SPDX-License-Identifier: Apache-2.0
//
// One stream's H.264 back to pictures, by libavcodec: one access unit in, one picture out.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <span>

#include "proto/base/result.h"
#include "proto/watch/picture_message.h"

namespace mixstage {

// The decoder's own buffers, until its next call. Planes of 8 bit (CV_8U, colour stream) or 10 (CV_16U, depth
// stream); luma [h x w], chroma [(h+1)/2 x (w+1)/2].
struct DecodedPlanes {
  cv::Mat y, cb, cr;
};

// Bytes are a stranger's: what cannot be decoded whole is refused, nothing is concealed, and pictures have at
// most 16 million pixels. One thread at a time.
class VideoDecoder {
 public:
  // Fails with kUnavailable where libavcodec has no H.264 decoder.
  static Result<VideoDecoder> Create(WatchStream stream);
  VideoDecoder(VideoDecoder&&) noexcept;
  VideoDecoder& operator=(VideoDecoder&&) noexcept;
  ~VideoDecoder();

  // The first access unit, and the first after a failure, must be a key frame's. Fails with kBadInput.
  Result<DecodedPlanes> Decode(std::span<const std::uint8_t> access_unit);
  // Forgets the pictures before: what comes next is a key frame.
  void Reset();

 private:
  class Impl;
  explicit VideoDecoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace mixstage
