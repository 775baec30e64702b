// SPDX-License-Identifier: Apache-2.0
//
// The three per-pixel steps of DepthEvidence, a row at a time, SIMD by Highway; any width, no alignment
// needed. A row's last pixels go through the same code one by one, so every width gives the same values.
#pragma once

#include <cstdint>

#include "server/segmentation/depth_evidence.h"

namespace mixstage {

// Far behind the room (in sigma): a thing has been taken away, or a range wrapped round. Neither room nor
// actor.
inline constexpr float kBehind = -4.0f;
// Log-odds from which a pixel is counted as in front of the room, and as the room.
inline constexpr float kFront = 1.0f;
inline constexpr float kRoom = -0.5f;
// Share of the 3x3 around a pixel that must be measured before depth speaks there with its whole weight: of a
// gap between legs it knows the legs.
inline constexpr float kMeasured = 2.0f / 3;
// Share of a window that must agree before depth's word is taken as final.
inline constexpr float kHalfTrust = 0.85f;
inline constexpr float kFullTrust = 0.98f;

struct DepthRow {
  const float* D;
  const float* D_M;
  const float* sigma;
  const float* room_weight;
  const float* log_peak;
};

// Eq. (1) as log-odds times weight, and the weight (0 at holes).
void WeighDepthRow(const DepthRow& row, int width, const DepthEvidenceConfig& config, float* weight,
                   float* weighted);
// Means of both -> log-odds; front and room: 255 where that is clear.
void DecideDepthRow(const float* weight, const float* weighted, int width, float* log_odds,
                    std::uint8_t* front, std::uint8_t* room);
// front, room: now shares (0..255) of a window that say so. Of those that say anything, how many agree with
// the pixel?
void TrustDepthRow(const std::uint8_t* front, const std::uint8_t* room, int width, float edge_weight,
                   float* log_odds, float* inside);

}  // namespace mixstage
