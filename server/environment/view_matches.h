// SPDX-License-Identifier: Apache-2.0
//
// Where the same point of the room stands in the pictures of a sweep: textured patches of one view, carried
// into the others by pose and depth and aligned there to a fraction of a pixel (Lucas-Kanade with gain and
// offset).
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/environment/color_panorama.h"
#include "server/environment/surface_mesh.h"

namespace mixstage {

struct ViewMatch {
  int from = 0, to = 0;      // views
  Eigen::Vector3d p_from;    // the point in the camera of `from`, metres
  Eigen::Vector2d at_to;     // (x/z, y/z) where it was found in `to`
  Eigen::Vector2d moved_px;  // how far that is from where the poses had it, pixels of the whole picture
};

// shrink: the pictures' pixels are so many of the camera's; what is searched for may be 3 of them away.
Result<std::vector<ViewMatch>> MatchViews(const SurfaceMesh& mesh, const PinholeCamera& camera,
                                          const std::vector<PosedPicture>& views, int shrink);

}  // namespace mixstage
