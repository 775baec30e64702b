// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/broadcast.h"

#include <utility>

#include "proto/base/clock.h"

namespace mixstage {

Result<Broadcast> Broadcast::Create(const BroadcastConfig& config, const PinholeCamera& camera,
                                    const std::string& show_name, Gateway* gateway) {
  auto color = VideoEncoder::Create(config.color, camera.width, camera.height);
  if (!color) return Within("colour encoder", color.error());
  auto depth = VideoEncoder::Create(config.depth, camera.width, camera.height);
  if (!depth) return Within("depth encoder", depth.error());
  auto range = DepthRangeFit::Create({});
  if (!range) return Within("depth range", range.error());
  return Broadcast(std::move(*color), std::move(*depth), std::move(*range), show_name,
                   {camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy}, gateway);
}

Broadcast::Broadcast(VideoEncoder color, VideoEncoder depth, DepthRangeFit range, std::string name,
                     WatchCamera camera, Gateway* gateway)
    : color_(std::move(color)),
      depth_(std::move(depth)),
      range_(std::move(range)),
      name_(std::move(name)),
      camera_(camera),
      gateway_(gateway) {}

Status Broadcast::Send(Frame& frame, StageTimes& times) {
  if (gateway_ != nullptr && gateway_->TakeKeyFrameRequest()) {
    color_.RequestKeyFrame();
    depth_.RequestKeyFrame();
  }
  const bool first = gateway_ == nullptr || !hello_sent_;
  if (first || gateway_->WantsStream(WatchStream::kColor)) {
    if (auto ok = SendColor(frame, times); !ok) return ok;
  }
  if (first || gateway_->WantsStream(WatchStream::kDepth)) {
    if (auto ok = SendDepth(frame, times); !ok) return ok;
  }
  frame.encoded_us = MonotonicMicros();
  if (gateway_ != nullptr && !hello_sent_) {
    gateway_->SetHello({.name = name_,
                        .server_us = 0,
                        .streams = {{WatchStream::kColor, color_.codec(), color_.width(), color_.height()},
                                    {WatchStream::kDepth, depth_.codec(), depth_.width(), depth_.height()}},
                        .camera = camera_});
    hello_sent_ = true;
  }
  return {};
}

Status Broadcast::SendColor(const Frame& frame, StageTimes& times) {
  const StageTimer timer(times, "encode_color");
  auto picture = color_.Encode(To420(frame.composite), frame.captured->capture_us);
  if (!picture) return tl::unexpected(picture.error());
  Publish(frame, WatchStream::kColor, *picture, {0, 0});
  return {};
}

Status Broadcast::SendDepth(const Frame& frame, StageTimes& times) {
  const StageTimer timer(times, "encode_depth");
  // near and far stand in every message, but change only where decoding starts afresh.
  if (depth_.KeyFrameDue(frame.captured->capture_us)) {
    range_.Update(View(frame.depth_mm));
    range_in_force_ = range_.range();
  }
  PackDepth(View(frame.depth_mm), View(frame.alpha), View(frame.label), range_in_force_, &packed_);
  auto picture = depth_.Encode(packed_, frame.captured->capture_us);
  if (!picture) return tl::unexpected(picture.error());
  Publish(frame, WatchStream::kDepth, *picture, range_in_force_);
  return {};
}

void Broadcast::Publish(const Frame& frame, WatchStream stream, const EncodedPicture& picture,
                        DepthRange range) {
  *bytes_ += static_cast<std::int64_t>(picture.access_unit.size());
  if (gateway_ == nullptr) return;
  gateway_->Publish(MakeWatchPicture({.stream = stream,
                                      .key_frame = picture.key_frame,
                                      .frame = static_cast<std::uint64_t>(frame.captured->frame),
                                      .capture_us = frame.captured->capture_us,
                                      .encoded_us = MonotonicMicros(),
                                      .near_m = range.near_m,
                                      .far_m = range.far_m},
                                     picture.access_unit));
}

}  // namespace mixstage
