// SPDX-License-Identifier: Apache-2.0
//
// The synthetic room's plan: world frame, metres. The head stands near the origin and looks along +x, a
// little to the left (+y), where the window is.
#pragma once

#include <Eigen/Core>

namespace mixstage::room_plan {

inline constexpr double kBackX = 5.6, kFrontX = -1.4, kLeftY = 2.6, kRightY = -3.3, kCeilingZ = 2.7;

// The window's opening in the left wall and how deep the pane sits in it.
inline constexpr double kWindowX0 = 2.75, kWindowX1 = 4.95, kWindowZ0 = 0.78, kWindowZ1 = 2.25,
                        kPaneY = kLeftY + 0.2;

// A soft box under the ceiling, shining down.
inline constexpr double kSoftboxX = 2.3, kSoftboxY = -0.9, kSoftboxZ = 2.66, kSoftboxHalf = 0.26;

// The lamp on the sideboard: its bulb.
inline constexpr double kLampX = 5.36, kLampY = 1.28, kLampZ = 1.12;

// Where an object can stand: on free floor, well seen.
// The figure passes behind kNearSpot while he turns (7.3..8.9 s of the loop), and in front of kFarSpot on his
// way in (5.2..6.0 s) and out (18.9..19.6 s).
inline const Eigen::Vector3d kNearSpot(2.72, 1.05, 0.0);  // free: radius 0.28 m
inline const Eigen::Vector3d kFarSpot(4.78, -0.38, 0.0);  // free: radius 0.30 m

// In the room and not in the floor: a camera can stand there.
[[nodiscard]] inline bool Inside(const Eigen::Vector3d& p) {
  return p.x() > kFrontX && p.x() < kBackX && p.y() > kRightY && p.y() < kLeftY && p.z() > 0.2 &&
         p.z() < kCeilingZ;
}

}  // namespace mixstage::room_plan
