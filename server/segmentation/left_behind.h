// SPDX-License-Identifier: Apache-2.0
//
// Things left behind in the set (MISSION 23): on command what stands still under a pixel becomes part of the
// empty set, with its colours and its depth. Nothing does so by itself: a person who stands still stays
// actor.
#pragma once

#include <array>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/environment/room_prediction.h"
#include "server/segmentation/background_model.h"
#include "server/segmentation/half_picture.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

// A thing as it was seen, and from where. Immutable.
struct AdoptedThing {
  RigidTransform T_world_color = RigidTransform::Identity();
  cv::Rect box;                     // pixels of the half-size picture; what follows is [box]
  cv::Mat1b mask;                   // 255 = the thing
  std::array<cv::Mat1f, 3> mean;    // R, G, B in the light of the room's own colours
  std::array<cv::Mat1f, 3> spread;  // variance of one measurement
  cv::Mat1f depth_m;                // z along the colour camera's axis; 0 = not known
  float depth_sigma_m = 0;          // of one measurement, > 0
};

// What a frame shows, as the key left it.
struct SeenFrame {
  RigidTransform T_world_color;
  const HalfPicture* picture = nullptr;
  ToneChange tone;
  const cv::Mat1b* half_mask = nullptr;  // Key::half_mask
  // [h x w] z in metres, 0 = hole; empty where no depth was measured since the frame before.
  ImageView<const float> new_depth_m;
};

// Looks for about a second at what a person has pointed at. One thread at a time.
class LeftBehind {
 public:
  static constexpr int kFrames = 30;

  // u, v: px of the picture. What was being looked at before is forgotten.
  void Look(double u, double v);
  // A frame; nothing until enough have come. Then the thing, or kBadInput and a sentence for its author:
  // nothing in the foreground stands still there, it fills the picture, the camera moved. `room`: what the
  // key compared with; of one size throughout (checked).
  std::optional<Result<std::shared_ptr<const AdoptedThing>>> See(const SeenFrame& frame,
                                                                 const BackgroundModel& room);

 private:
  [[nodiscard]] Result<std::shared_ptr<const AdoptedThing>> Decide(const BackgroundModel& room) const;

  std::optional<cv::Point> at_;  // half-size pixels
  int frames_ = 0, depth_frames_ = 0;
  RigidTransform T_world_color_;
  cv::Mat1f in_front_;                     // [Half x Half] frames in which it was actor
  std::array<cv::Mat1f, 3> sum_, square_;  // [Half x Half]
  cv::Mat1f depth_count_, depth_sum_, depth_square_;
};

// The thing among the empty set that the same camera sees from the same place.
void LayThing(const AdoptedThing& thing, BackgroundModel* model);

// The thing in the room's picture from any pose; where the room hides it, or the thing was not seen from
// there, the room stays. rays: UnprojectionTable(camera); the prediction's size is the camera's (checked).
void LayThing(const AdoptedThing& thing, const PinholeCamera& camera, const cv::Mat2f& rays,
              const RigidTransform& T_world_color, RoomPrediction* room);

}  // namespace mixstage
