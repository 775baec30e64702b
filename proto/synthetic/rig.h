// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "proto/geometry/rig.h"

namespace mixstage {

// The cameras of the demonstration: colour 1024x768 and time of flight 176x144 on a head that stands
// still, 1.4 m above the floor. deploy/demo/rig.json is the same rig as a file.
Rig SyntheticRig();

// Where the colour camera stands in the synthetic room: the rig's head at rest (encoders at 0), or the
// demonstration's place where the rig has no pan-tilt unit or puts its head outside the room.
RigidTransform SyntheticTWorldColor(const Rig& rig);

}  // namespace mixstage
