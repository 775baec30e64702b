// SPDX-License-Identifier: Apache-2.0
//
// What the figure does, as a function of time: where his pelvis, feet and hands are. A loop of kLoop_s: an
// empty set, he enters on the right at the far depth, crosses to the window, turns, comes back nearer to the
// camera, stops, waves, and leaves on the right.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace mixstage {

inline constexpr double kLoop_s = 24.0;
inline constexpr double kEnter_s = 3.0, kLeave_s = 22.0;  // he exists in [kEnter_s, kLeave_s) of the loop

struct FootPose {
  Eigen::Vector3d ankle_rest = Eigen::Vector3d::Zero();  // world, m: the sole's point below the ankle
  double yaw_rad = 0;
  double lift = 0;   // 0 planted .. 1 highest
  double swing = 0;  // 0 just lifted .. 1 just put down; 0 while planted
};

struct WalkState {
  Eigen::Vector2d body = Eigen::Vector2d::Zero();  // world, m: below the pelvis
  double yaw_rad = 0;                              // where the pelvis faces, 0 = +x
  double stride = 0;                               // 0 standing .. 1 walking
  double phase = 0;                                // in steps; even: the left foot swings
  FootPose foot[2];                                // left, right
  double wave = 0;                                 // 0..1: right hand raised and waving
  double wave_angle = 0;                           // rad, of the waving forearm
  double present = 0;                              // 0..1: left arm offered to the side
  double look_yaw_rad = 0;                         // of the head, relative to the pelvis
};

class Walk {
 public:
  Walk();

  // Seconds into the loop of any time.
  static double LoopTime(double time_s);
  static bool Present(double time_s);
  // MIX_CHECKs Present(time_s).
  [[nodiscard]] WalkState At(double time_s) const;

 private:
  struct Step {
    double lift_s, land_s;
    Eigen::Vector2d place;
    double yaw_rad;
  };

  std::vector<Step> steps_[2];  // by foot, in time
};

}  // namespace mixstage
