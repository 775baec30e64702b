// SPDX-License-Identifier: Apache-2.0
//
// The joint adjustment of hand-eye calibration: every corner's pixel against mechanism, mount, boards and, in
// every view, a correction of what the encoders say. Noise of pixels and encoders is estimated with it
// (expectation-maximisation over the corrections).
//
// A pan-tilt head in its own frame, without freedom left over (Denavit and Hartenberg): the pan axis is z
// through the origin; the tilt axis passes it nearest at (a, 0, 0) with direction (0, -cos b, sin b).
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/frames.h"
#include "server/calibration/deviations.h"
#include "server/calibration/lens.h"

namespace mixstage {

enum class HeadKind {
  kPanTilt = 1,  // a view's correction: pan, tilt (rad)
  kRobot,        // rotation vector (rad) and translation, both in the hand's frame
};

enum class OutlierLoss {
  kCauchy = 1,  // of boards and corrections: views in doubt are still among them
  kHuber,       // of corners only
};

struct HandEyeAdjustment {
  struct Camera {
    Lens lens;
    // How well the calibration knows the lens' numbers; they are adjusted within that. Zero: held.
    std::array<double, kLensNumbers> lens_expected{};
    LensCovariance lens_covariance = LensCovariance::Zero();
    RigidTransform T_camera_color = RigidTransform::Identity();
    double noise_px = 0.15;
  };
  struct View {
    bool used = false;
    double pan_rad = 0, tilt_rad = 0;                                              // kPanTilt
    RigidTransform T_base_hand = RigidTransform::Identity();                       // kRobot
    Eigen::Matrix<double, 6, 1> correction = Eigen::Matrix<double, 6, 1>::Zero();  // the first 2 or all 6
  };
  struct Sighting {
    std::size_t view = 0, camera = 0, board = 0;
    std::vector<Eigen::Vector3d> p_board;  // z = 0
    std::vector<Eigen::Vector2d> pixels;
    bool used = false;
    std::vector<Eigen::Vector2d> off_px;  // out: predicted minus seen, of the last solution
    double rms_px = 0;
  };

  HeadKind kind = HeadKind::kPanTilt;
  std::vector<Camera> cameras;
  std::vector<View> views;
  std::vector<Sighting> sightings;

  // a, b, pan scale, tilt scale. What is expected of any head before the first picture, and how far it may be
  // off: keeps directions that the views leave open from running away and shows them by their deviation.
  Eigen::Vector4d mechanism{0, 0, 1, 1};
  Eigen::Vector4d mechanism_expected{0, 0, 1, 1};
  Eigen::Vector4d mechanism_sd{0.1, 0.05, 0.05, 0.05};
  RigidTransform T_hand_color = RigidTransform::Identity();
  double mount_sd_m = 0.5, mount_sd_rad = 0.5;  // of T_hand_color about its start
  std::vector<RigidTransform> T_base_board;

  // Of one correction: pan and tilt (rad), or rotation (rad) and translation.
  Eigen::Vector2d encoder_noise{0.03 * 0.0174533, 0.03 * 0.0174533};

  // Out: of mechanism (4; 0 for a robot), T_hand_color's rotation (about the hand's axes, rad), its
  // translation.
  Eigen::Matrix<double, 10, 10> covariance = Eigen::Matrix<double, 10, 10>::Zero();

  [[nodiscard]] int corrections() const { return kind == HeadKind::kPanTilt ? 2 : 6; }
  // T_base_color of a view, its correction included.
  [[nodiscard]] RigidTransform TBaseColor(const View& view) const;
};

// Standard deviations of T_color1_color2 between two positions of a pan-tilt head, by the covariance alone:
// encoders without noise. Rotation (rad) and translation, each the root of the three variances' sum; root
// mean square over all pairs of the positions (pan, tilt; rad).
struct RelativeDeviation {
  double rotation_rad = 0, translation = 0;
};
RelativeDeviation DeviationBetween(const HandEyeAdjustment& problem,
                                   const std::vector<Eigen::Vector2d>& positions);

// Rounds of solving and of estimating noise, until that settles. Fails (kQualityGate) where nothing
// converges.
Status Adjust(HandEyeAdjustment& problem, OutlierLoss loss);

}  // namespace mixstage
