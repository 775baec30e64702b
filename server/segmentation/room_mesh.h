// SPDX-License-Identifier: Apache-2.0
//
// The empty set as a surface in the scene, with its mean picture on it: what stands around the actor where a
// viewer looks from elsewhere (MixIn3D 2.3's environment as far as one view knows it).
#pragma once

#include <cstddef>

#include "proto/base/result.h"
#include "proto/codec/yuv_image.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/segmentation/background_model.h"
#include "server/segmentation/picture_mesh.h"

namespace mixstage {

struct RoomMeshConfig {
  std::size_t max_triangles = 60'000;  // > 0: the grid is as fine as this allows, 4 px at least
  float step_m = 0.1f;                 // > 0: a lower step is surface
  float step_sigmas = 3.0f;            // > 0: and so is one that the sensor's noise explains
};

// A grid over D_M, torn where a step exceeds max(step_m, step_sigmas x sigma / cos) by more than the
// surface's own slope explains; cos: of the angle between the ray and the surface's normal, on the flatter
// side of the step. Empty where the room has no depth. uvs and crop are those of the whole picture. The model
// is the camera's (sizes are checked).
[[nodiscard]] PictureMesh MakeRoomMesh(const BackgroundModel& room, const PinholeCamera& color,
                                       const RigidTransform& T_scene_color, const RoomMeshConfig& config);

// I_m of piVE eq (1) as a picture [Half(h) x Half(w)], 4:2:0.
[[nodiscard]] YuvImage RoomPicture(const BackgroundModel& room);

}  // namespace mixstage
