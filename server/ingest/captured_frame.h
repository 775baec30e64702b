// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "proto/codec/yuv_image.h"

namespace mixstage {

// One picture of the depth camera, in its own pixels and counts (DepthCamera::unit_m of the rig).
struct DepthPicture {
  std::int64_t capture_us = 0;  // server clock
  std::int64_t sequence = 0;    // tells one picture from the next
  cv::Mat1w counts;             // [h x w], 0 = no measurement
  cv::Mat1w amplitude;          // [h x w], or empty
};

struct HeadAngles {
  double pan_deg = 0, tilt_deg = 0;
};

// A frame is born at a colour picture; with it goes the newest depth that was exposed before it, or at its
// instant. What a camera gave, paired, on the server's clock; immutable once published.
struct CapturedFrame {
  std::int64_t frame = 0;       // counts the camera's pictures since the start, lost ones too
  std::int64_t epoch = 0;       // of the agent; 0 offline
  std::int64_t capture_us = 0;  // server clock (offline: the take's own), mid-exposure of the colour picture
  YuvImage color;
  std::shared_ptr<const DepthPicture> depth;  // null: none yet, or it has stopped
  std::optional<HeadAngles> head;
  std::string stem;     // offline: the colour file's stem
  double take_t_s = 0;  // offline: the colour file's timestamp
};

}  // namespace mixstage
