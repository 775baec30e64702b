// SPDX-License-Identifier: Apache-2.0
//
// The room's surface at every pixel of the panorama: which of the planes around a pixel it lies on, and what
// is where nothing was measured.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "server/environment/surface_fit.h"

namespace mixstage {

// Nodes without a plane (not seen, or nothing but noise came back: black things, panes, lamps) that are
// wanted take the plane of the nearest that have one. wanted [node]. How many were filled.
int FillNodes(SurfaceNodes& nodes, const std::vector<std::uint8_t>& wanted);

struct DenseSurface {
  cv::Mat1f inverse_range;  // [h x w] of the grid, 1/m; 0 = nothing known
  cv::Mat1i node;           // [h x w] the node whose plane the pixel lies on; -1 = none
};

// Every pixel takes the plane, of those of the nodes around it, that its neighbourhood votes for: near nodes,
// planes that meet what was measured there. Where two of the room's planes meet, the edge is their
// intersection.
DenseSurface MakeDense(const SurfaceNodes& nodes, const FusedDepth& fused, const PanoramaGrid& grid);

}  // namespace mixstage
