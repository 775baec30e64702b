// SPDX-License-Identifier: Apache-2.0
//
// The large planes of a room (algorithms 4): grown over nodes that lie on them within their noise, fitted by
// least squares in inverse range, where the noise is even. A plane of a thousand noisy nodes is exact to a
// millimetre: they are pulled onto it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "server/environment/environment.h"
#include "server/environment/surface_fit.h"

namespace mixstage {

struct PlaneConfig {
  double least_area_m2 = 0.15;
  int least_nodes = 60;
};

// A plane seen from the panorama's centre c: 1/range = m . ray, that is n . (x - c) = 1 / |m| with n = m /
// |m| pointing away from the centre.
struct GrownPlane {
  Eigen::Vector3d m = Eigen::Vector3d::Zero();
  double area_m2 = 0;
  int nodes = 0;
  double rms_sigma = 0;  // residuals in sigmas: about 1 for a true plane
};

// Needs nodes.plane (FitPlanes). Sets nodes.room_plane and, where it is set, nodes.plane. Largest area first.
std::vector<GrownPlane> GrowPlanes(SurfaceNodes& nodes, const PlaneConfig& config);

// The floor: of the large planes that are level within 15 degrees and below the centre the lowest; -1 = none.
[[nodiscard]] int FindFloor(const std::vector<GrownPlane>& planes);

// Names, kinds and outlines (convex, of the nodes on it) in the world.
std::vector<RoomPlane> DescribePlanes(const std::vector<GrownPlane>& planes, const SurfaceNodes& nodes,
                                      const Eigen::Vector3d& center);

}  // namespace mixstage
