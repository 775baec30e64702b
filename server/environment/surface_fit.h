// SPDX-License-Identifier: Apache-2.0
//
// The fused depth, noisy and with ragged edges, as local planes (algorithms 4: edge-aware regularisation). A
// plane n . x = d seen from the panorama's centre is 1/range = m . ray with m = n / d: a fit is linear least
// squares on what was averaged, whatever the projection.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "server/environment/depth_fusion.h"

namespace mixstage {

// One node for about each pixel of the depth camera, step x step pixels of the fused picture each.
struct SurfaceNodes {
  int step = 1;  // pixels of the fused picture
  int width = 0, height = 0;
  bool closed = false;               // the last column's right neighbour is the first
  std::vector<Eigen::Vector3f> ray;  // of the block's centre
  std::vector<float> inverse_range;  // 1/m, 0 = not seen
  std::vector<float> sigma;
  std::vector<Eigen::Vector3f> plane;  // m; 0 = none
  std::vector<int> room_plane;         // index of the room's large plane it lies on; -1 = none

  [[nodiscard]] int At(int x, int y) const {  // -1 outside
    if (y < 0 || y >= height) return -1;
    if (x < 0 || x >= width) {
      if (!closed) return -1;
      x = (x % width + width) % width;
    }
    return y * width + x;
  }
};

// Pixels of a grid that make a node for a depth camera whose pixels are pitch_rad apart.
[[nodiscard]] int NodeStep(const PanoramaGrid& grid, float pitch_rad);

// The grid's sides are multiples of step (checked).
SurfaceNodes MakeNodes(const FusedDepth& fused, const PanoramaGrid& grid, int step);

// Forgets small islands amid nodes that saw nothing: what noise happens to agree on, in a window or on a
// black thing.
void DropIslands(SurfaceNodes& nodes);

// Fits a plane to every seen node from those around it that lie on it within their noise. Planes spread to
// neighbours that fit them better than their own, so that near and far side of a step each keep to
// themselves; a thin thing keeps its own depth, a lone node that nothing supports takes its neighbours'.
// Nodes on a plane of the room (room_plane) stay as they are and teach nobody.
void FitPlanes(SurfaceNodes& nodes);

}  // namespace mixstage
