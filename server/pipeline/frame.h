// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/geometry/frames.h"
#include "server/ingest/captured_frame.h"
#include "server/physics/physics_event.h"
#include "server/render/cg_renderer.h"
#include "server/render/light_map.h"

namespace mixstage {

// One frame on its way through the stages: each stage reads what stages above it wrote (frame_stages.cc).
// Pictures are [h x w] of the colour camera, in its distorted view; with an avatar those from place_avatar on
// are of the target's camera: the view. After the last stage of the frame thread nothing is changed.
struct Frame {
  std::shared_ptr<const CapturedFrame> captured;
  RigidTransform T_world_color = RigidTransform::Identity();

  cv::Mat1f D;              // warp_depth: sensor's z, metres, 0 = unknown; empty = the frame has no depth;
                            // from move_depth on at the picture's instant, the worker's until its next frame
  double depth_age_s = 0;   // move_depth: >= 0, what its motion may not have taken off
  bool keyed = false;       // key_actor: false while the empty set is being learnt
  cv::Mat1b label;          // key_actor: 0 background, 1 actor, 2 shadow of the actor, 255 unknown
  cv::Mat1b alpha;          // key_actor: coverage of the actor, linear; place_avatar: in the view
  cv::Mat1f actor_depth_m;  // actor_surface: z of the actor, half size, 0 = not known; the worker's, until
                            // its next frame; place_avatar: in the view
  RigidTransform T_world_view = RigidTransform::Identity();  // place_camera, place_avatar
  YuvImage view_picture;  // place_avatar: the view with the actor in it; empty = the captured picture is it
  std::vector<PhysicsEvent> events;     // step_physics
  const CgLayer* cg = nullptr;          // render_scene: null = no CG; the renderer's, until its next frame
  const LightMap* light_map = nullptr;  // light_map: null = no CG; the mapper's, until its next frame
  YuvImage composite;                   // z_key
  cv::Mat1w depth_mm;                   // z_key: z of what the composite shows, mm, 0 = unknown
  cv::Mat1b cg_alpha;                   // z_key: visible coverage of CG

  // What the view shows that is real.
  [[nodiscard]] const YuvImage& Real() const { return view_picture.empty() ? captured->color : view_picture; }

  std::int64_t encoded_us = 0;  // encode: server clock when the encoders were done
};

// Frames with their buffers, used again when nobody holds them any more. One thread takes, any thread lets
// go.
class FramePool {
 public:
  [[nodiscard]] std::shared_ptr<Frame> Take() {
    for (const std::shared_ptr<Frame>& frame : frames_) {
      if (frame.use_count() == 1) return frame;
    }
    return frames_.emplace_back(std::make_shared<Frame>());
  }

 private:
  std::vector<std::shared_ptr<Frame>> frames_;
};

}  // namespace mixstage
