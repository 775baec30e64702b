// SPDX-License-Identifier: Apache-2.0
//
// Where a camera stands over the floor, by one picture of depth: the lowest large plane that is level for a
// camera held by a person (piVE 5: unified camera parameters, where a video brings none).
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "proto/base/image_view.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"

namespace mixstage {

// What is up for the camera, and its height over that floor.
struct FloorSeen {
  Eigen::Vector3d up = -Eigen::Vector3d::UnitY();  // camera's frame, of length 1
  double height_m = 0;                             // > 0
};

// depth_m [h x w] z in metres, 0 = unknown, in the camera's own view. Nothing where no plane within 60
// degrees of the picture's level, at least 0.3 m below the camera, has a twentieth of what is known.
// Deterministic.
[[nodiscard]] std::optional<FloorSeen> FindFloorBelow(ImageView<const float> depth_m,
                                                      const PinholeCamera& camera);

}  // namespace mixstage
