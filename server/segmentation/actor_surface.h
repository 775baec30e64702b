// SPDX-License-Identifier: Apache-2.0
//
// How far the actor is, at every pixel of his matte: MixIn3D 2.4's D_key made whole. It decides what stands
// in front, actor or CG (MixIn3D 3.1), so it has no holes, no flying pixels and nothing of the wall behind
// him.
#pragma once

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

class ActorSurface {
 public:
  // Fails with kInvalidConfig where a value is out of its range.
  static Result<ActorSurface> Create(const ActorSurfaceConfig& config);

  // mask     [Half(h) x Half(w)]  > 0 actor (Key::half_mask)
  // depth_m  [h x w]  D: z in metres in the colour camera, 0 = unknown; empty = none: then the surface is
  // empty too model    for D_M and its noise; may have no depth: then every measurement inside the mask
  // counts as his Nothing of earlier frames is used, so nothing lags. Allocates on a new size only; one
  // thread at a time.
  void Run(const cv::Mat1b& mask, ImageView<const float> depth_m, const BackgroundModel& model);

  // Of the last Run, [Half(h) x Half(w)]: z in metres > 0 at every pixel of the mask, 0 outside. All 0 where
  // depth saw nothing of him at all.
  [[nodiscard]] const cv::Mat1f& depth_m() const { return surface_; }

 private:
  explicit ActorSurface(const ActorSurfaceConfig& config) : config_(config) {}
  void KeepActor(const BackgroundModel& model);
  void DropFlying();
  void Smooth();
  void BuildPyramid();
  float FromPyramid(int x, int y, std::size_t level) const;
  void FillHoles();

  ActorSurfaceConfig config_;
  cv::Mat1f depth_, sigma_, scratch_, surface_;  // depth_, sigma_, scratch_ [Quarter(h) x Quarter(w)]
  cv::Mat1b mask_, around_;                      // [Quarter(h) x Quarter(w)]
  cv::Rect box_;                                 // of around_: nothing outside is touched
  std::vector<cv::Mat1f> sum_, count_;           // pyramid of what is known, [0] = Quarter
};

}  // namespace mixstage
