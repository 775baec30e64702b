// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "proto/codec/yuv_image.h"
#include "server/render/cg_renderer.h"

namespace mixstage {

// The room without the actor, in the colour camera's view: what a background model knows of depth, at full size.
struct RoomDepth {
  std::uint64_t revision = 0;  // differs between any two rooms that one ZKey sees; not 0
  cv::Mat1f depth_m;  // [h x w] z, 0 = not known
  cv::Mat1f sigma_m;  // [h x w] its noise, > 0 where depth_m > 0
};

struct ZKeyInput {
  const YuvImage* color = nullptr;          // the camera's picture, any chroma layout
  ImageView<const std::uint8_t> alpha;      // [h x w] coverage of the actor, linear; empty = no actor is known
  ImageView<const float> actor_depth_m;     // [(h+1)/2 x (w+1)/2] z of the actor, 0 = not known; empty like alpha
  const RoomDepth* room = nullptr;          // null = the room's depth is not known: CG stands before all of it
  const CgLayer* cg = nullptr;              // null = no CG
};

// Mutual occlusion per pixel (MixIn3D 3.1, piVE 5): the nearest of room, actor and CG is seen. Everything that is not
// virtual is the camera's own picture, untouched. CG is mixed in linear light by its visible coverage:
//   seen = coverage x (1 - alpha where the actor is nearer) x (0 where the room is nearer, 1 elsewhere)
// An actor whose depth is not known stands in front, as in any key without depth.
// The papers compare depths as they are; the sensor's noise would let the floor flicker through an object's foot, so
// the room hides CG only where it is nearer by kRoomSigmas of its own noise.
class ZKey {
 public:
  static constexpr float kRoomSigmas = 3.f;

  // composite  same size and layout as the picture: its planes are copied, then CG is drawn over them
  // depth_mm   [h x w] z of what is seen, mm, 0 = unknown
  // cg_alpha   [h x w] visible coverage of CG
  // Sizes that differ are a caller's bug (checked). One thread at a time; allocates on a new size or layer only.
  void Run(const ZKeyInput& in, YuvImage& composite, cv::Mat1w& depth_mm, cv::Mat1b& cg_alpha);

 private:
  void PrepareLayer(const CgLayer& cg);
  void PrepareRoom(const RoomDepth& room);
  void ContinueActor(ImageView<const float> actor_depth_m);
  void DrawRow(const ZKeyInput& in, int y, YuvImage& composite, cv::Mat1w& depth_mm, cv::Mat1b& cg_alpha);
  void MixChroma(const ZKeyInput& in, const cv::Mat1b& cg_alpha, YuvImage& composite) const;

  // Of the layer that was drawn last: opaque CG needs no blending, its Y'CbCr is made once.
  std::uint64_t layer_drawing_ = 0;
  cv::Mat3b layer_ycbcr_;    // [bounds] un-premultiplied
  cv::Mat1b room_in_front_;  // [bounds] 255 where the room hides CG
  std::uint64_t room_of_layer_ = 0;  // revision of the room that room_in_front_ was made for; 0 = none
  // Of the room.
  std::uint64_t room_revision_ = 0;
  cv::Mat1w room_mm_;
  cv::Mat1f actor_z_, actor_around_;  // half size: the actor's depth, continued over the matte's soft edge
  cv::Mat3b mixed_;  // [bounds] Y'CbCr of this frame where cg_alpha > 0
};

}  // namespace mixstage
