// SPDX-License-Identifier: Apache-2.0
//
// The empty room as a camera sees it, computed once: linear light in three layers, so that a figure can take
// away the light of each lamp where its shadow falls.
#pragma once

#include <opencv2/core.hpp>

#include "proto/geometry/frames.h"
#include "proto/synthetic/plate_lens.h"
#include "proto/synthetic/room.h"
#include "proto/synthetic/room_light.h"

namespace mixstage {

// Planes are padded: rows and columns go to the next multiple of kTile, so that tiles need no remainder.
inline constexpr int kTile = 32;
// Shadows of the figure are computed at every kNodeStep-th pixel.
inline constexpr int kNodeStep = 4;

struct RoomPlate {
  int width = 0, height = 0;                // px, of the picture
  int padded_width = 0, padded_height = 0;  // px
  // [padded] world direction of a pixel, as long as the lens makes it: per metre of depth for the colour
  // camera (p = origin + z * ray).
  cv::Mat1f ray[3];
  cv::Mat1f window[3];  // [padded] linear r, g, b as the camera records it (lens shading included), 1 = white
  cv::Mat1f softbox[3];  // [padded]
  cv::Mat1f rest[3];     // [padded] bounced light, the lamp, what shines itself
  cv::Mat1f vignette;    // [padded] 0..1
  // [padded / kNodeStep + 1] surface points and normals at pixels (kNodeStep i, kNodeStep j), world frame.
  cv::Mat1f node_point[3], node_normal[3];
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  // the camera's centre, world

  // Ray at any place of the padded picture, between the pixels' own; outside the picture or where the lens
  // has none the nearest that exists.
  [[nodiscard]] Eigen::Vector3d RayAt(double u, double v) const;
};

enum class PlateRays {
  kOne = 1,   // a pixel, light in the rough: for a room behind boards, at which nobody looks
  kFour = 4,  // edges and textures without stairs
};

// About a second on two cores for 1024x768 with four rays, a third of it with one.
RoomPlate RenderRoomPlate(const Room& room, const RoomLight& light, const PlateLens& lens,
                          const RigidTransform& T_world_camera, PlateRays rays = PlateRays::kFour);

}  // namespace mixstage
