// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <stop_token>
#include <variant>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"
#include "proto/link/frame_slice.h"

namespace mixstage {

// One thing a head's sensor gave, with the time of its mid-exposure on this machine's monotonic clock.
struct CapturedPicture {
  Stream stream = Stream::kColor;
  // JPEG bytes as they came, planes still to be encoded, or a 16-bit picture (depth, amplitude).
  std::variant<std::vector<std::uint8_t>, YuvImage, cv::Mat1w> content;
  int width = 0, height = 0;  // px
};
struct CapturedAngles {
  double pan_deg = 0, tilt_deg = 0;
};
struct Captured {
  std::int64_t t_us = 0;
  std::variant<CapturedPicture, CapturedAngles> what;
};

enum class Pace {
  kReal = 1,  // at the sensor's own rates
  kMax,       // as fast as the network takes them, nothing dropped
};

// A camera head: real, recorded or synthetic (one file each). One thread.
class Source {
 public:
  virtual ~Source() = default;
  // Waits until the next picture is due; nothing when the source has ended or `stop` was asked for. An error
  // is one picture that could not be had: the caller counts it and goes on.
  virtual Result<std::optional<Captured>> Next(std::stop_token stop) = 0;
};

// Sleeps until the monotonic clock reads `due_us`; false when `stop` came first.
bool WaitUntil(std::int64_t due_us, const std::stop_token& stop);

}  // namespace mixstage
