// SPDX-License-Identifier: Apache-2.0
//
// Depth keying, MixIn3D 2.4 eq (1): what stands in front of the room is actor. Here as log-odds, so that
// noise, steps, holes and age weigh what they are worth.
#pragma once

#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "server/segmentation/background_model.h"

namespace mixstage {

struct DepthEvidenceConfig {
  float most = 5.0f;         // log-odds at which "in front of the room" saturates
  float least = -3.0f;       // the same for "is the room"
  float edge_weight = 0.5f;  // 0..1: what depth's word is worth within reach of its own outline
  // What moving depth to the picture's instant leaves of an actor's 1.5 m/s: with the depth's age, how far
  // his outline may have moved on.
  float actor_speed_m_s = 0.5f;
};

// All [Quarter(h) x Quarter(w)].
class DepthEvidence {
 public:
  // depth_m [h x w]: D, warped into the colour camera, z in metres, 0 = hole (unknown: parallax strips, mixed
  // pixels). age_s >= 0: colour's instant less depth's. Allocates on a new size only.
  void Run(ImageView<const float> depth_m, float age_s, const BackgroundModel& model,
           const DepthEvidenceConfig& config);

  // Log-odds of "actor", 0 where depth says nothing; weak within reach of depth's outline, full away from it.
  [[nodiscard]] const cv::Mat1f& log_odds() const { return log_odds_; }
  // 0..1: 1 = so deep inside depth's actor that neither its age nor its coarse grid can matter.
  [[nodiscard]] const cv::Mat1f& inside() const { return inside_; }

 private:
  cv::Mat1f depth_m_, weighted_, weight_, log_odds_, inside_;
  cv::Mat1b front_, room_;  // 255 where depth says so; then averaged over the reach of its outline
};

// The equation as printed: 255 where D_M - D > sigma, 0 elsewhere; a hole (D = 0 or D_M = 0) is never
// foreground. sigma_m of each pixel; all views of one size. The baseline to compare with.
void DepthKey(ImageView<const float> room_depth_m, ImageView<const float> sensor_depth_m,
              ImageView<const float> sigma_m, ImageView<std::uint8_t> mask);

}  // namespace mixstage
