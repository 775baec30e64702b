// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>

#include "proto/geometry/rig.h"

namespace mixstage {

// A camera as the room's plate is drawn through it.
struct PlateLens {
  int width = 0, height = 0;  // px
  // Direction of a pixel in the camera's frame; nothing where the lens has no ray. Its length is the lens'
  // own: z = 1 for a pinhole, 1 for a fisheye.
  std::function<std::optional<Eigen::Vector3d>(const Eigen::Vector2d& pixel)> ray;
  // What the lens lets through there, >= 0; 0 outside its circle.
  std::function<double(const Eigen::Vector2d& pixel)> gain;
};

PlateLens ColorLens(const Rig& rig);
PlateLens FisheyeLens(const FisheyeCamera& camera);

}  // namespace mixstage
