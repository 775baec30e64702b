// SPDX-License-Identifier: Apache-2.0
//
// How far the actor is, at every pixel of his matte: MixIn3D 2.4's D_key made whole. It decides what stands
// in front, actor or CG (MixIn3D 3.1), so it has no holes, no flying pixels and nothing of the wall behind
// him.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "server/segmentation/background_model.h"

namespace mixstage {

struct ActorSurfaceConfig {
  float same_surface_m =
      0.25f;  // > 0: depths within this (and within 4 sigma) are smoothed together; a body's thickness
  int smoothing_rounds = 2;  // 0..4
};

// When depth was measured, on any clock, and the colour picture's instant less that: what moved across the
// view was moved before (server/depth/depth_motion), how much nearer it came is ActorSurface's.
struct DepthInstant {
  std::int64_t measured_us = 0;
  double age_s = 0;  // >= 0
};

class ActorSurface {
 public:
  // Fails with kInvalidConfig where a value is out of its range.
  static Result<ActorSurface> Create(const ActorSurfaceConfig& config);

  // mask     [Half(h) x Half(w)]  > 0 actor (Key::half_mask)
  // depth_m  [h x w]  D: z in metres in the colour camera, 0 = unknown; empty = none: then the surface is
  //          empty too
  // model    for D_M and its noise; may have no depth: then every measurement inside the mask counts as his
  // Of earlier frames only his speed along the view is used, to bring an older depth to the picture's
  // instant. Allocates on a new size only; one thread at a time.
  void Run(const cv::Mat1b& mask, ImageView<const float> depth_m, const BackgroundModel& model,
           const DepthInstant& instant = {});

  // Of the last Run, [Half(h) x Half(w)]: z in metres > 0 at every pixel of the mask, 0 outside. Where depth
  // saw nothing of him at all: where he was last, else where his feet meet the room (the room's depth at his
  // lowest pixel, or beside it); all 0 where that is not known either.
  [[nodiscard]] const cv::Mat1f& depth_m() const { return surface_; }

 private:
  explicit ActorSurface(const ActorSurfaceConfig& config) : config_(config) {}
  void KeepActor(const BackgroundModel& model);
  void DropFlying();
  void Smooth(int step);
  void BuildPyramid();
  void LearnSpeed(std::int64_t measured_us);
  void Advance(double age_s);
  float FromPyramid(int x, int y, std::size_t level) const;
  void FillHoles();
  void StandSomewhere(const BackgroundModel& model);

  ActorSurfaceConfig config_;
  cv::Mat1f depth_, sigma_, scratch_, surface_;  // depth_, sigma_, scratch_ [Quarter(h) x Quarter(w)]
  cv::Mat1b mask_, around_;                      // [Quarter(h) x Quarter(w)]
  cv::Mat1f before_;                             // [Quarter] depth_ of the depth picture before
  cv::Mat1f speed_, pace_;                       // [blocks], [Quarter] m/s away from the camera
  std::int64_t measured_us_ = 0;                 // of depth_
  bool has_before_ = false;
  float last_m_ = 0;  // of what was known of him last; 0 = nothing since he came
  std::vector<float> steps_, all_steps_;
  cv::Rect box_;                        // of around_: nothing outside is touched
  std::vector<cv::Mat1f> sum_, count_;  // pyramid of what is known, [0] = Quarter
};

}  // namespace mixstage
