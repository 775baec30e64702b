// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "proto/geometry/camera_model.h"

namespace mixstage {

// The camera of a picture of half the size, rounded up: its pixels are samples in the middle of 2 x 2 of the
// full picture's.
inline PinholeCamera HalfCamera(const PinholeCamera& camera) {
  PinholeCamera half = camera;
  half.width = (camera.width + 1) / 2;
  half.height = (camera.height + 1) / 2;
  half.fx = 0.5 * camera.fx;
  half.fy = 0.5 * camera.fy;
  half.cx = 0.5 * (camera.cx + 0.5) - 0.5;
  half.cy = 0.5 * (camera.cy + 0.5) - 0.5;
  return half;
}

}  // namespace mixstage
