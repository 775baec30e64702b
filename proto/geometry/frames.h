// SPDX-License-Identifier: Apache-2.0
//
// The frames of MixStage, named once.
//   world    right-handed, z up, floor at z = 0, metres
//   camera   x right, y down, z forward (OpenCV); "color", "depth", "fisheye" are cameras
//   head     the pan-tilt unit's moving part; its camera frame of reference is "color"
//   object   a model file's own coordinates
// T_a_b maps points of frame b into frame a: p_a = T_a_b * p_b; equal neighbours cancel in a chain. In files
// it is 4x4, row-major. Pixel centres are integers: a picture spans [-0.5, width - 0.5] x [-0.5, height -
// 0.5]. depth is z along the optical axis, range the length along the ray; 0 means "no measurement" for both.
#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <string>

#include "proto/base/result.h"

namespace mixstage {

using RigidTransform = Eigen::Isometry3d;

// Reads 16 numbers, row-major. Fails when one is not finite, the last row is not 0 0 0 1, or the rotation is
// not one (R^T R = I and det R = 1 within 1e-3; what is left of rounding is removed).
Result<RigidTransform> RigidFromRowMajor(const std::array<double, 16>& numbers);

// Same for a transform that may scale and mirror (an object's placing): finite, affine, |det| > 1e-12.
Result<Eigen::Affine3d> AffineFromRowMajor(const std::array<double, 16>& numbers);

// One line of a TUM trajectory "tx ty tz qx qy qz qw" (T_world_camera).
Result<RigidTransform> RigidFromTum(const std::array<double, 7>& numbers);
std::string TumLine(double timestamp_s, const RigidTransform& T_world_camera);

}  // namespace mixstage
