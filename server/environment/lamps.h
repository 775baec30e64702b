// SPDX-License-Identifier: Apache-2.0
//
// The room's lamps (MixIn3D 2.3, 3.2): what is clipped in the pictures shines, how much shows in the light on
// the walls.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "server/environment/dense_surface.h"
#include "server/environment/environment.h"
#include "server/environment/room_planes.h"

namespace mixstage {

struct LampConfig {
  int clipped = 250;             // sRGB level: at or above it in every channel
  double least_area_m2 = 0.004;  // of a lamp
  double gap_m = 0.12;  // bars of a window: panes of one plane that are nearer to each other are one lamp
};

// Area lights, largest first. color [h x w] of the grid, A = 0 not seen. A clipped region becomes a rectangle
// on its surface. Radiance by robust least squares on the room's large planes, where all lamps shine freely:
// log radiance(x) = log albedo + log(around(x) + sum of the lamps' form factors x radiance). The albedo of a
// plane is unknown; around is what the panorama's other surfaces send to x (interreflection, one bounce as
// measured), which fixes the unit: the picture's. What needs no light
// of its own is left out.
std::vector<RoomLamp> FindLamps(const cv::Mat4b& color, const DenseSurface& dense, const SurfaceNodes& nodes,
                                const std::vector<GrownPlane>& planes, const PanoramaGrid& grid,
                                const LampConfig& config);

// Share of a lamp's light, radiance 1, that arrives at x on a surface of normal n: integral of cos cos / (pi
// r^2).
[[nodiscard]] double FormFactor(const RoomLamp& lamp, const Eigen::Vector3d& x, const Eigen::Vector3d& n);

}  // namespace mixstage
