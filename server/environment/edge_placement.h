// SPDX-License-Identifier: Apache-2.0
//
// Depth edges at the pixels where the pictures have theirs (algorithms 4: edge-aware regularisation): a depth
// camera's pixel is five of a colour camera's, and an edge drawn from it is ragged by half of one. In every
// view the pixels beside an edge choose the near or the far surface by a vote of their neighbourhood, near
// pixels of one colour counting most (weighted mode filtering: Min, Lu, Do, IEEE TIP 2012); in the panorama a
// pixel keeps the near surface where the views see it there and not through it.
#pragma once

#include <vector>

#include "proto/base/result.h"
#include "server/environment/color_panorama.h"
#include "server/environment/dense_surface.h"
#include "server/environment/surface_mesh.h"

namespace mixstage {

// `dense` is changed beside its edges alone, and only from one of the two surfaces to the other. draft: its
// mesh. Fails where no picture can be drawn.
Status PlaceEdges(const SurfaceMesh& draft, const PinholeCamera& camera,
                  const std::vector<PosedPicture>& views, const SurfaceNodes& nodes, const PanoramaGrid& grid,
                  DenseSurface& dense);

// One view's part of it. bgr, inverse_depth: [h x w], 1/m, 0 = nothing there. Returns inverse depth, moved.
[[nodiscard]] cv::Mat1f SnapToColor(const cv::Mat3b& bgr, const cv::Mat1f& inverse_depth);

}  // namespace mixstage
