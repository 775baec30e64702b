// SPDX-License-Identifier: Apache-2.0
//
// From what the views saw to a fitted adjustment: a start by the views' consensus, views in doubt left out
// one by one, scales held that nothing contradicts. The same for a pan-tilt head and for a robot's hand.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "server/calibration/hand_eye.h"
#include "server/calibration/hand_eye_adjustment.h"

namespace mixstage {

struct HandEyeSolve {
  // A sighting that a camera of the input has, with what the start makes of it.
  struct Seen {
    std::size_t view, camera;
    const BoardSighting* sighting;
  };

  HandEyeSolve(const std::vector<Board>& fixed_boards, HeadKind kind, std::size_t views);

  const std::vector<Board>& boards;  // borrowed
  std::vector<std::string> names;
  std::vector<RigidTransform> T_base_hand;  // ideal: axes at right angles through the origin
  std::vector<Seen> seen;
  HandEyeAdjustment problem;
  std::vector<HandEyeViewFit> fits;
  std::vector<std::string> held;
};

// Fails (kBadInput) on a board or corner that does not exist and on pixels that are not finite.
Status CheckSighting(const std::string& view, const std::vector<Board>& boards,
                     const BoardSighting& sighting);

// Poses of boards, the agreement of the views, and from that the adjustment's start. Fails (kQualityGate) on
// too few views, too little turn, and angles that do not belong to the pictures.
Status Start(HandEyeSolve& solve, const Eigen::Matrix3d& R_hand_color_guess);

// Adjusts, leaves out views in doubt, holds scales, and tells how each view fits. Fails (kQualityGate) where
// fewer than half the views fit or corners are far off.
Status Fit(HandEyeSolve& solve);

}  // namespace mixstage
