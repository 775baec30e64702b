// SPDX-License-Identifier: Apache-2.0
//
// Lossless coding of 16-bit pictures (depth, amplitude): predictor over holes, zigzag, byte planes, zstd. The
// noise of the sensor is evidence for the key, so nothing may be lost; PNG is several times slower
// (SPEC.md 3.2).
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/base/result.h"

namespace mixstage {

inline constexpr int kDepthCodecMaxSide = 8192;  // px, either side
inline constexpr std::int64_t kDepthCodecMaxPixels = 34'000'000;

// Holds zstd's state and scratch memory: one per thread, no allocation once warm.
class DepthEncoder {
 public:
  DepthEncoder();
  ~DepthEncoder();
  // picture [h x w], 1..8192 on each side (checked: a caller's bug). Replaces what is in `bytes`.
  void Encode(ImageView<const std::uint16_t> picture, std::vector<std::uint8_t>& bytes);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

class DepthDecoder {
 public:
  DepthDecoder();
  ~DepthDecoder();
  // Fails on any byte string that Encode could not have written; never allocates more than the limits above
  // allow, and not before the compressed stream itself states the same size as the header.
  Status Decode(std::span<const std::uint8_t> bytes, cv::Mat1w& picture);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace mixstage
