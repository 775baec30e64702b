// SPDX-License-Identifier: Apache-2.0
//
// Tsai's camera calibration from points of known place in one picture (R. Y. Tsai, "A versatile camera
// calibration technique for high-accuracy 3D machine vision metrology", IEEE J. Robotics and Automation 3(4),
// 1987, stages 1 and 2 of the coplanar and the non-coplanar method; piVE 2): f, k1, the centre, the scale s_x
// and R, T.
//   u = s_x x_d + c_x, v = y_d + c_y,  (x_d, y_d) = f g (x/z, y/z),  g = 1 + k1 ((x/z)^2 + (y/z)^2),
//   p_camera = R p_world + T.
// k1 is PinholeCamera's, from true to distorted; Tsai's kappa_1 goes the other way (kappa_1 f^2 = -k1 to
// first order). The radial alignment, on which the linear stage stands, holds for both.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"

namespace mixstage {

struct PointInPicture {
  Eigen::Vector3d p_world;  // in the target's own units: T_camera_world has the same
  Eigen::Vector2d pixel;
};

struct TsaiCalibration {
  PinholeCamera camera;  // fx = s_x f, fy = f, cx, cy, k1; all else 0
  RigidTransform T_camera_world = RigidTransform::Identity();
  double sx = 1;
  double rms_px = 0;  // sqrt of the mean squared distance of a point from its prediction
  bool coplanar = false;
  // Standard deviations, 0 where held. Of the noise that the residuals show.
  double f_sd_px = 0, k1_sd = 0, cx_sd_px = 0, cy_sd_px = 0, sx_sd = 0;
  Eigen::Vector3d rotation_sd_rad = Eigen::Vector3d::Zero();  // about the camera's axes
  Eigen::Vector3d translation_sd = Eigen::Vector3d::Zero();   // of the points' mean, in the camera's frame
  // What the points cannot tell and was therefore kept, in words: "sx at 1: the points lie in a plane".
  std::vector<std::string> held;
};

// centre_px: where the lens' axis is thought to meet the picture (default: the picture's centre). The linear
// stage needs it, the refinement moves it unless the points determine it to no better than 2 % of the width.
// Fails: kBadInput on numbers that are not finite, fewer than 8 points (6 in a plane), points in a line;
// kQualityGate when f and T_z cannot be told apart (a plane nearly parallel to the picture) or nothing fits.
Result<TsaiCalibration> CalibrateTsai(std::span<const PointInPicture> points, int width, int height,
                                      std::optional<Eigen::Vector2d> centre_px = std::nullopt);

}  // namespace mixstage
