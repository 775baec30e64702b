// SPDX-License-Identifier: Apache-2.0
//
// The light that CG objects are shaded by: a few lamps and a sky-and-floor ambient (piVE section 4). Levels
// are those of scene/scene.h: 1.0 = the picture's white, in linear light; a matt white surface shows
// irradiance / pi.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "server/scene/scene.h"

namespace mixstage {

struct Illumination {
  std::vector<Light> lights;                                // scene frame
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();            // scene frame, unit
  Eigen::Vector3f ambient_above = Eigen::Vector3f::Zero();  // irradiance / pi on a surface that faces up
  Eigen::Vector3f ambient_below = Eigen::Vector3f::Zero();  // ... that faces down
};

// The scene's lights with an ambient for what the room scatters; a scene without lights gets a soft key light
// from above, left and in front (world scenes: as seen along the x axis).
[[nodiscard]] Illumination IlluminationOf(const Scene& scene);

[[nodiscard]] bool SameLight(const Illumination& a, const Illumination& b);

}  // namespace mixstage
