// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/codec/yuv_image.h"
#include "server/render/cg_renderer.h"

namespace mixstage {

// The room without the actor, in the colour camera's view: what a background model knows of depth, at full
// size.
struct RoomDepth {
  std::uint64_t revision = 0;  // differs between any two rooms that one ZKey sees; not 0
  cv::Mat1f depth_m;           // [h x w] z, 0 = not known
  cv::Mat1f sigma_m;           // [h x w] its noise, > 0 where depth_m > 0
};

struct ZKeyInput {
  const YuvImage* color = nullptr;      // the camera's picture, any chroma layout
  ImageView<const std::uint8_t> alpha;  // [h x w] coverage of the actor, linear; empty = no actor is known
  ImageView<const float>
      actor_depth_m;  // [(h+1)/2 x (w+1)/2] z of the actor, 0 = not known; empty like alpha
  const cv::Mat3b* foreground = nullptr;  // [h x w] R, G, B: the actor's own colour where 0 < alpha < 255,
                                          // without the room's share; null = the picture's
  const RoomDepth* room = nullptr;        // null = the room's depth is not known: CG stands before all of it
  const CgLayer* cg = nullptr;            // null = no CG
};

// Mutual occlusion per pixel (MixIn3D 3.1, piVE 5): the nearest of room, actor and CG is seen. Everything
// that is not virtual is the camera's own picture, untouched. CG is mixed in linear light by its visible
// coverage:
//   seen = coverage x (1 - alpha where the actor is nearer) x (0 where the room is nearer, 1 elsewhere)
// Before CG an actor's soft edge has his own colour: the room that the camera saw through it is not there any
// more.
// An actor whose depth is not known stands in front, as in any key without depth.
// The papers compare depths as they are; the sensor's noise would let the floor flicker through an object's
// foot, so the room hides CG only where it is nearer by kRoomSigmas of its own noise. And nobody stands
// behind the room's surface: CG that lies in it as closely (a marble floor, an object's foot) hides no shoe,
// whatever the noise of the shoe's own depth.
class ZKey {
 public:
  static constexpr float kRoomSigmas = 3.f;

  // composite  same size and layout as the picture: its planes are copied, then CG is drawn over them
  // depth_mm   [h x w] z of what is seen, mm, 0 = unknown
  // cg_alpha   [h x w] visible coverage of CG
  // Sizes that differ are a caller's bug (checked). One thread at a time; allocates on a new size or layer
  // only.
  void Run(const ZKeyInput& in, YuvImage& composite, cv::Mat1w& depth_mm, cv::Mat1b& cg_alpha);

 private:
  // A stretch of a layer's row that is alike: covered by CG wholly or in part, lying in the room's surface or
  // before it.
  struct Stretch {
    int begin = 0, end = 0;  // columns of the layer
    bool opaque = false;
    bool on_surface = false;
  };
  struct Span {
    int begin = 0, end = 0;  // columns of the picture; empty: 0, 0
  };

  void PrepareRoom(const RoomDepth& room);
  void PrepareLayer(const CgLayer& cg);
  void FindStretches(const CgLayer& cg, const RoomDepth* room);
  void PrepareActor(const ZKeyInput& in);
  void DrawActorDepth(const std::uint8_t* alpha, int y, std::uint16_t* depth_mm) const;
  void DrawRow(const ZKeyInput& in, int row, YuvImage& composite, cv::Mat1w& depth_mm, cv::Mat1b& cg_alpha);
  void MixChromaRow(const ZKeyInput& in, int chroma_y, YuvImage& composite) const;

  // Of the layer that was drawn last: opaque CG needs no blending, its Y'CbCr is made once.
  std::uint64_t layer_drawing_ = 0;
  cv::Mat1b layer_y_, layer_cb_, layer_cr_;  // [bounds] un-premultiplied
  cv::Mat1w layer_mm_;                       // [bounds]
  // What of it the room leaves to be seen, row by row.
  std::uint64_t room_of_stretches_ = 0;  // revision of the room they were made for; 0 = without
  bool stretches_known_ = false;
  std::vector<Stretch> stretches_;
  std::vector<std::size_t> row_begin_;  // [bounds.height + 1] index into stretches_
  // Of the room.
  std::uint64_t room_revision_ = 0;
  cv::Mat1w room_mm_;
  // Of the frame's actor. Half size, known inside the box of his coverage only: his depth, continued over the
  // matte's soft edge.
  std::vector<Span> actor_spans_;  // [h] of coverage > 0
  cv::Mat1f actor_z_;
  cv::Mat1w actor_mm_;
  // Of the frame: how CG is seen (values of Seen) and, where it is mixed, its chroma.
  cv::Mat1b seen_, mixed_cb_, mixed_cr_;  // [bounds]
};

}  // namespace mixstage
