// SPDX-License-Identifier: Apache-2.0
//
// Two scans made one room (MixIn3D 2.3): panoramas from several positions merged, or what changed in a room
// scanned again. Each scan knows where its own rays ended: along them everything before the end is empty,
// what is behind is not known.
#pragma once

#include "proto/base/result.h"
#include "server/environment/environment_folder.h"

namespace mixstage {

enum class Join {
  kMerge = 1,  // the first keeps all it saw; the second adds what was hidden from there
  kPatch,      // the second is newer: what it sees replaces what the first has there
};

struct JoinReport {
  double turn_deg = 0, shift_m = 0;  // the second was moved by so much to meet the first
  double met = 0;      // share 0..1 of the second's points in the first's sight that lie on its surface
  double apart_m = 0;  // rms of those along the surface's normal
  double gain = 1;     // the second's brightness was multiplied by
  std::size_t dropped = 0, added = 0;  // triangles of the first that went, of the second that came
};

// The motion that lays `second` onto `first`: point to plane, each point held against the end of the first's
// ray through it (projective association), from 0.5 m down to the noise. Starts where both worlds are the
// same; about 0.3 m and 10 degrees are found. Fills turn, shift, met and apart.
RigidTransform MeetRooms(const RoomScan& first, const RoomScan& second, JoinReport& report);

// In the world of `first`. Its panorama stays the picture of the room; the surface's texture is both pictures
// one upon the other. Planes and lamps of both, those that are the same once.
RoomScan JoinRooms(const RoomScan& first, const RoomScan& second, const RigidTransform& T_first_second,
                   Join join, JoinReport& report);

}  // namespace mixstage
