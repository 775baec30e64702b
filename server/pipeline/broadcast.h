// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>

#include "proto/base/result.h"
#include "proto/geometry/camera_model.h"
#include "server/delivery/depth_packer.h"
#include "server/delivery/gateway.h"
#include "server/delivery/video_encoder.h"
#include "server/pipeline/frame.h"
#include "server/pipeline/stage_times.h"

namespace mixstage {

struct BroadcastConfig {
  VideoEncoderConfig color;
  VideoEncoderConfig depth{.format = VideoFormat::kDepth10, .bitrate_bps = 2'000'000};
};

// The last stages of a frame: H.264 of the composite, inverse depth with matte, delivery. One encode for all
// viewers. Owned by the thread that encodes (`encode` live, inline for `process --encode`).
class Broadcast {
 public:
  // `gateway` may be null: then everything is encoded and handed to nobody (measuring).
  static Result<Broadcast> Create(const BroadcastConfig& config, const PinholeCamera& camera,
                                  const std::string& show_name, Gateway* gateway);

  // Encodes what is watched. A stream that nobody watches is not encoded, but for the first frame, which
  // tells viewers the codecs. Fails when an encoder fails.
  Status Send(Frame& frame, StageTimes& times);

  [[nodiscard]] std::int64_t bytes_sent() const { return *bytes_; }

 private:
  Broadcast(VideoEncoder color, VideoEncoder depth, DepthRangeFit range, std::string name, WatchCamera camera,
            Gateway* gateway);
  Status SendColor(const Frame& frame, StageTimes& times);
  Status SendDepth(const Frame& frame, StageTimes& times);
  void Publish(const Frame& frame, WatchStream stream, const EncodedPicture& picture, DepthRange range);

  VideoEncoder color_, depth_;
  DepthRangeFit range_;
  DepthRange range_in_force_{};
  Yuv10Image packed_;
  std::string name_;
  WatchCamera camera_;
  Gateway* gateway_;
  bool hello_sent_ = false;
  std::shared_ptr<std::atomic<std::int64_t>> bytes_ = std::make_shared<std::atomic<std::int64_t>>(0);
};

}  // namespace mixstage
