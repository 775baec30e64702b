// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "proto/geometry/rig.h"

namespace mixstage {

// The rig of the demonstration as it truly is: colour 1024x768, time of flight 176x144 and a fisheye of 190
// degrees on a pan-tilt head 1.4 m above the floor, whose axes are a little askew and whose encoders count a
// little wrong. deploy/demo/rig.json is the same rig as a file.
Rig SyntheticRig();

// The same rig as its data sheets and a tape measure have it, where calibration starts:
// deploy/demo/nominal.json.
Rig SyntheticNominalRig();

// Where the colour camera stands in the synthetic room at encoder angles (default: at rest); the
// demonstration's place where the rig has no pan-tilt unit or puts its head outside the room.
RigidTransform SyntheticTWorldColor(const Rig& rig, double pan_deg = 0, double tilt_deg = 0);

}  // namespace mixstage
