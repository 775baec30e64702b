// SPDX-License-Identifier: Apache-2.0
//
// Hand-eye calibration (MixIn3D 2.3; algorithms 4): how a camera sits on what moves it, from boards fixed in
// the room. Start: Park and Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group", 1994,
// by consensus of the views. Then one adjustment of everything on pixels; intrinsics and T_color_depth are
// held. What the encoders report is an observation with its own noise (estimated), not the truth: 0.01 deg
// are 0.2 px.
//
// Frames: base (the head's foot), tilt or hand (what moves), color, board (board.h).
//   pan-tilt head: T_base_color = R(pan axis, s_p pan + o_p) R(tilt axis, s_t tilt + o_t) T_tilt_color
//   (rig.h) robot:         T_base_color = T_base_hand T_hand_color
// Held by convention, because nothing in the pictures tells: the offsets o_p, o_t (the rig's; turning the
// tilt axis and T_tilt_color does the same) and the base. With a `ptu` in the rig: its pan axis, the height
// at which the tilt axis passes it, the tilt axis' heading, T_world_base. Without: base z is the pan axis,
// up; its origin is where the tilt axis passes nearest; x points along the colour camera's axis at zero
// angles; the world is the base (a scan finds the floor).
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/calibration/board_detection.h"
#include "server/calibration/deviations.h"

namespace mixstage {

// A figure, its standard deviation and their unit ("deg", "mm", "1").
struct HandEyeFigure {
  std::string name;
  double value = 0, sd = 0;
  std::string unit;
};

// What became of a view.
struct HandEyeViewFit {
  std::string name;
  bool used = false;
  std::string reason;  // why it was left out: "pan encoder 1.01 deg off"
  double rms_px = 0;   // of its corners, all cameras; 0 without boards
  // What is to be added to what the encoders said (scale applied) for the pictures to fit. Robot: rotation
  // angle.
  double pan_correction_deg = 0, tilt_correction_deg = 0, rotation_correction_deg = 0;
  double translation_correction_mm = 0;
};

struct HeadView {
  std::string name;
  double pan_deg = 0, tilt_deg = 0;  // as the encoders say
  // The others count where the colour camera sees no board.
  std::vector<BoardSighting> color, amplitude, fisheye;  // by the rig's cameras; amplitude: the ToF camera's
};

struct HandEyeInput {
  Rig rig;
  // Of the lenses' numbers (lens.h), by the calibration that found them; they are adjusted within it. Zero:
  // held.
  LensCovariance color_covariance = LensCovariance::Zero();
  LensCovariance depth_covariance = LensCovariance::Zero();
  LensCovariance fisheye_covariance = LensCovariance::Zero();
  std::vector<Board> boards;  // fixed in the room
  std::vector<HeadView> views;
};

struct HandEyeResult {
  PanTilt ptu;
  std::vector<RigidTransform> T_base_board;  // boards that no used view has: identity
  std::vector<HandEyeViewFit> views;         // as given
  std::vector<HandEyeFigure> figures;        // of the mechanism, with standard deviations
  // Directions that the views leave weak (worse than 0.05 deg or 2 mm), in words, the worst first.
  std::vector<std::string> weak;
  double pan_noise_deg = 0, tilt_noise_deg = 0;                             // of the encoders
  double color_noise_px = 0, amplitude_noise_px = 0, fisheye_noise_px = 0;  // of a coordinate; 0 without
  // Predicted pose between two positions within 40 deg of pan and 34 of tilt, rms: what a sweep of the room
  // asks.
  double sweep_sd_deg = 0, sweep_sd_mm = 0;
  std::vector<std::string> held;  // scales kept at the rig's since the views do not contradict, in words
};

// Fails (kQualityGate, the reason named) with fewer than 4 usable views, less than 5 deg of pan and of tilt,
// angles that do not belong to the pictures (out of step, columns exchanged), or a fit beyond 1 px or 0.3
// deg; kBadInput on numbers that are not finite and boards that do not exist. Views in doubt are left out and
// say so.
Result<HandEyeResult> CalibrateHandEye(const HandEyeInput& input);

struct RobotView {
  std::string name;
  RigidTransform T_base_hand = RigidTransform::Identity();
  std::vector<BoardSighting> sightings;
};

struct RobotHandEyeInput {
  PinholeCamera camera;
  std::vector<Board> boards;
  std::vector<RobotView> views;
};

struct RobotHandEyeResult {
  RigidTransform T_hand_color = RigidTransform::Identity();
  std::vector<RigidTransform> T_base_board;
  std::vector<HandEyeViewFit> views;
  std::vector<HandEyeFigure> figures;
  std::vector<std::string> weak;
  double rotation_noise_deg = 0, translation_noise_mm = 0;  // of the robot's poses, a coordinate
  double noise_px = 0;
};

// The same through the same adjustment, for a hand whose pose is given whole. Needs rotations about two axes.
Result<RobotHandEyeResult> CalibrateRobotHandEye(const RobotHandEyeInput& input);

}  // namespace mixstage
