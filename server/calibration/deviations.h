// SPDX-License-Identifier: Apache-2.0
//
// How well an adjustment determines what it found: standard deviations from the inverse of its normal
// equations, which for Gaussian noise is the Cramer-Rao bound, and widened, one factor a camera, where boards
// contradict each other by more than independent pixels (or corners) can: a sandwich estimate over boards
// (White 1980; Liang and Zeger 1986), unbiased where the noise is independent.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <vector>

#include "server/calibration/lens.h"

namespace mixstage {

using LensCovariance = Eigen::Matrix<double, kLensNumbers, kLensNumbers>;

struct CameraDeviation {
  std::array<double, kLensNumbers> lens{};  // of each number; 0 where it was not estimated
  LensCovariance lens_covariance = LensCovariance::Zero();
  // Of T_first_camera, about and along the axes of the first camera; 0 for the first camera itself.
  Eigen::Vector3d turn_deg = Eigen::Vector3d::Zero();
  Eigen::Vector3d shift_m = Eigen::Vector3d::Zero();
};

// One per camera, in their order; nothing for a camera that took no part.
using Deviations = std::vector<std::optional<CameraDeviation>>;

}  // namespace mixstage
