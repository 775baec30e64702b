// SPDX-License-Identifier: Apache-2.0
//
// Colour's word on each pixel, as log-odds of "actor": against the room as learned, and against the room in
// shadow.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "server/segmentation/background_model.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

// Evidence is kept in bytes: 128 = no opinion, above = actor, 1/16 of a natural log-odd a step, saturating at
// +-8.
constexpr int kNoEvidence = 128;
constexpr float kEvidencePerByte = 1.0f / 16.0f;

struct ColorEvidence {
  cv::Mat1b
      room;  // [Half(h) x Half(w)] against "the room as it is": piVE 3 eq (3)-(4) with a sigma per channel
  cv::Mat1b shadow;  // [Half(h) x Half(w)] against "the room, darkened": piVE 3 eq (5)-(8)
};

struct ShadowConfig {
  float chroma_tolerance =
      0.08f;                    // 0..1: a shadow may differ in hue by this share of the light that it lacks
  float usual_least = 0.8f;     // 0..1: shadows down to this brightness are taken as usual ...
  float darkness_cost = 25.0f;  // ... and cost this many log-odds per unit of brightness below
};

// texture [Quarter(h) x Quarter(w)]: log-odds from ShadowTexture, added to the shadow hypothesis. actor
// [Half(h) x Half(w)]: how well the colour becomes an actor (ActorColors), bytes as above, added to both.
// Scalar specification and SIMD twin; they differ by one step at most, where a rounding falls on an edge.
void FindColorEvidenceScalar(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                             const ShadowConfig& config, const cv::Mat1f& texture, const cv::Mat1b& actor,
                             ColorEvidence* evidence);
void FindColorEvidence(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
                       const ShadowConfig& config, const cv::Mat1f& texture, const cv::Mat1b& actor,
                       ColorEvidence* evidence);

}  // namespace mixstage
