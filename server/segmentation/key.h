// SPDX-License-Identifier: Apache-2.0
//
// The key: which pixels are the actor. MixIn3D 2.4 (depth against the room) and piVE 3 (colour against the
// empty set, shadow as a third label) decide together: depth settles the inside and excludes shadow, colour
// places the edge.
#pragma once

#include <cstdint>

#include "proto/base/image_view.h"
#include "proto/base/result.h"
#include "server/segmentation/actor_colors.h"
#include "server/segmentation/background_model.h"
#include "server/segmentation/box_mean.h"
#include "server/segmentation/color_evidence.h"
#include "server/segmentation/depth_evidence.h"
#include "server/segmentation/edge_coverage.h"
#include "server/segmentation/labels.h"
#include "server/segmentation/neighbor_vote.h"
#include "server/segmentation/region_filter.h"
#include "server/segmentation/room_regions.h"
#include "server/segmentation/shadow_texture.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

struct KeyConfig {
  float actor_prior = -0.5f;  // log-odds of "actor" before anything is seen
  float room_weight = 8.0f;   // log-odds against "actor" where a whole neighbourhood equals the room
  float own_weight = 0.02f;   // of a pixel's own evidence beside its neighbourhood's mean
  ShadowConfig shadow{};
  DepthEvidenceConfig depth{};
  RegionConfig regions{};
};

class Key {
 public:
  // Fails with kInvalidConfig where a value is not finite or out of its range.
  static Result<Key> Create(const KeyConfig& config);

  // luma     [h x w]  this frame
  // picture  [Half(h) x Half(w)]  its colours
  // depth_m  [h x w]  D: z in metres in the distorted colour camera, 0 = unknown; empty = a colour-only frame
  // depth_age_s  >= 0: colour's instant less depth's (what motion compensation has not removed)
  // label    [h x w]  out: values of Label
  // alpha    [h x w]  out: coverage 0..255; >= 128 exactly where label is kLabelActor
  // regions  after its Run for this frame; null = none
  // Sizes that differ from the model's are a caller bug (checked). Remembers of earlier frames
  // which colours actors wore, and for the tone change where the last one was. Allocates on a new size only;
  // one thread at a time.
  void Run(const BackgroundModel& model, ImageView<const std::uint8_t> luma, const HalfPicture& picture,
           ImageView<const float> depth_m, float depth_age_s, ImageView<std::uint8_t> label,
           ImageView<std::uint8_t> alpha, const RegionMask* regions = nullptr);

  // Of the last Run, [Half(h) x Half(w)]: 255 actor, 0 else; not what is held out of the room. For the
  // actor's surface.
  [[nodiscard]] const cv::Mat1b& half_mask() const { return half_mask_; }
  // Of the last Run, [h x w] R, G, B: the actor's own colour, without the room's share of the pixel; known
  // where 0 < alpha < 255.
  [[nodiscard]] const cv::Mat3b& foreground() const { return edge_coverage_.foreground(); }
  [[nodiscard]] const ToneChange& tone() const { return tone_; }

 private:
  explicit Key(const KeyConfig& config) : config_(config) {}
  void BelieveTexture(const cv::Mat1f& depth);
  void Decide(const BackgroundModel& model);

  KeyConfig config_;
  ToneChange tone_;
  ShadowTexture shadow_texture_;
  DepthEvidence depth_evidence_;
  ActorColors actor_colors_;
  NeighborVote neighbor_vote_;
  RegionFilter region_filter_;
  EdgeCoverage edge_coverage_;
  ColorEvidence color_;
  BoxMean room_mean_{1};
  cv::Mat1f texture_, kept_;           // [Quarter x Quarter] of ShadowTexture
  cv::Mat1f most_;                     // [Quarter x Quarter] log-odds against "the room in another light"
  cv::Mat1b most_small_, most_bytes_;  // as bytes, the second at half size
  cv::Mat1b likelihood_, core_;        // [Half x Half]
  cv::Mat1b room_around_;  // [Half x Half] least mean of color_.room over 3x3 that holds the pixel
  cv::Mat1b depth_small_, inside_small_;  // [Quarter x Quarter] as bytes
  cv::Mat1b depth_, inside_;              // the same at half size
  cv::Mat1b evidence_, decision_;         // [Half x Half]
  cv::Mat1b half_mask_, half_alpha_, half_shadow_, actor_around_;
};

}  // namespace mixstage
