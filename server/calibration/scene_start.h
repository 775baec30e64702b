// SPDX-License-Identifier: Apache-2.0
//
// From sightings to a scene that an adjustment can start from: how the cameras sit to each other and where
// the boards stood.
#pragma once

#include <string>
#include <vector>

#include "server/calibration/board_scene.h"

namespace mixstage {

// The cameras' lenses are known; sets their poses and the placements'. A camera's pose is the one, of those
// its shared boards give, that the most corners of other boards agree with; boards that look the same upside
// down are turned where that makes the cameras agree. Cameras that share no board with the first (directly
// or through others) stay without a pose; names of these are returned.
std::vector<std::string> StartPoses(BoardScene& scene);

}  // namespace mixstage
