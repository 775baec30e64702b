// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <opencv2/core.hpp>
#include <optional>
#include <span>

#include "server/gl/framebuffer.h"

namespace mixstage::gl {

// The way back from the GPU: asked for, then waited for; between the two the processor is free. Several may
// be on their way at once.
class ReadBack {
 public:
  // Asks for the pixels of one colour attachment inside region. pixel_bytes: what layout and type come to.
  // Returns at once. Fails when the memory for it cannot be had.
  Status Start(const Current& current, const Framebuffer& from, int attachment, const cv::Rect& region,
               GLenum layout, GLenum type, std::size_t pixel_bytes);
  // The pixels, rows contiguous, valid until the next Start. Fails (kUnavailable) when the context was lost
  // meanwhile, or when the GPU hangs: it then counts as lost.
  Result<std::span<const std::byte>> Wait(const Current& current);

 private:
  std::optional<Name> buffer_;
  const std::byte* memory_ = nullptr;  // of buffer_, mapped for its life
  std::size_t capacity_ = 0, asked_ = 0;
  GLsync fence_ = nullptr;  // of the context: dies with it
};

}  // namespace mixstage::gl
