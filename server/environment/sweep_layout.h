// SPDX-License-Identifier: Apache-2.0
//
// Where a sweep's panorama stands, what it spans and how fine it is.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "proto/geometry/rig.h"
#include "server/environment/panorama.h"

namespace mixstage {

// Spherical, about the mean of the cameras' positions (algorithms 4 say the head's rotation centre; the
// colour camera sits decimetres off it and looks past edges that the mean of its own positions does not).
// Spans what the colour camera saw and a degree more. Pixels are 0.6 of the colour camera's, more where a
// side would pass 8,192: 4,000 x 3,300 for a sweep of 130 x 107 degrees by a 50 degree lens of 1,024 pixels.
// divisor: the picture's sides are multiples of it.
Panorama LayOutPanorama(const PinholeCamera& color, const std::vector<RigidTransform>& T_world_color,
                        int divisor);

// The same panorama with pixels `times` as large; its sides are multiples of it (checked).
Panorama Coarser(const Panorama& panorama, int times);

}  // namespace mixstage
