// SPDX-License-Identifier: Apache-2.0
//
// Projection with its derivatives, written out: analysis-by-synthesis needs them for every pixel.
#pragma once

#include <Eigen/Core>

#include "server/calibration/lens.h"

namespace mixstage {

struct LensJacobian {
  Eigen::Vector2d pixel;
  Eigen::Matrix<double, 2, 3> by_point;            // of the camera's frame
  Eigen::Matrix<double, 2, kLensNumbers> by_lens;  // filled by WithLens only
};

void ProjectWithPoint(LensKind kind, const double* lens, const Eigen::Vector3d& p_camera, LensJacobian& out);
void ProjectWithLens(LensKind kind, const double* lens, const Eigen::Vector3d& p_camera, LensJacobian& out);

}  // namespace mixstage
