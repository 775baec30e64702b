// SPDX-License-Identifier: Apache-2.0
//
// What stood elsewhere while one view of a sweep was taken: a chair that was moved, somebody who walked
// through. The majority keeps its place in the room's surface (Fuse); here it is found, so that it can be
// named and gives no colour.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "server/environment/color_panorama.h"
#include "server/environment/depth_fusion.h"

namespace mixstage {

// One view's connected part that contradicts the room by more than both noises explain.
struct MovedThing {
  std::size_t view = 0;
  double area_m2 = 0;
  Eigen::Vector3d at = Eigen::Vector3d::Zero();  // middle of what the view saw, world
  double nearer_m = 0;  // than the room, median; below 0: the room's surface was not there yet
  std::vector<std::array<Eigen::Vector3f, 2>>
      dots;  // each a point of it as the view saw it and as the room has it, world
};

// Largest first. patches: of the views, those that `fused` was made of. pitch_rad: between two pixels of the
// depth camera, narrower than three of which nothing is told from an edge.
std::vector<MovedThing> FindMovedThings(const std::vector<PanoramaPatch>& patches, const FusedDepth& fused,
                                        const PanoramaGrid& grid, float pitch_rad);

// Nothing of the room is seen through them: what a view shows there is no other view's surface.
void HideMovedThings(const std::vector<MovedThing>& things, const PinholeCamera& camera,
                     const std::vector<PosedPicture>& views, float pitch_rad,
                     std::vector<ViewOcclusion>& occlusions);

}  // namespace mixstage
