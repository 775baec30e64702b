// SPDX-License-Identifier: Apache-2.0
//
// Between the frame in which a head's mechanism is solved (hand_eye_adjustment.h) and the base of a rig
// (hand_eye.h says what is held by convention).
#pragma once

#include <optional>

#include "proto/geometry/rig.h"
#include "server/calibration/hand_eye_adjustment.h"

namespace mixstage {

// The frame in which the mechanism is solved, seen from the base: of a rig that has a ptu, and of one that
// has none.
RigidTransform BaseOfNominal(const PanTilt& nominal);
RigidTransform BaseByConvention(const RigidTransform& T_hand_color);

// The solved head as a rig states it.
PanTilt InBase(const HandEyeAdjustment& problem, const std::optional<PanTilt>& nominal,
               const RigidTransform& T_base_own);

}  // namespace mixstage
