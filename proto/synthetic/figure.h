// SPDX-License-Identifier: Apache-2.0
//
// The figure's body: some forty round cones, placed by what he does.
#pragma once

#include <Eigen/Core>
#include <array>

#include "proto/synthetic/round_cone.h"
#include "proto/synthetic/walk.h"

namespace mixstage {

enum class Shadowing { kNone = 1, kCasts };

struct BodyPart {
  RoundCone cone;                                    // world frame
  Eigen::Vector3f albedo = Eigen::Vector3f::Zero();  // linear, as the eye sees it
  float infrared = 0.5f;                             // albedo at the time-of-flight camera's wavelength
  Shadowing shadowing = Shadowing::kNone;            // small parts lie within larger ones' shadows
};

struct Figure {
  static constexpr int kMaxParts = 56;
  std::array<BodyPart, kMaxParts> parts;
  int count = 0;
};

// Fills `figure` with the body in a state of the walk. Allocates nothing.
void PoseFigure(const WalkState& state, Figure& figure);

}  // namespace mixstage
