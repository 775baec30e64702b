// SPDX-License-Identifier: Apache-2.0
//
// The sweep's range pictures seen from the panorama's centre and fused there (MixIn3D 2.3). Inverse range is
// what is averaged: over one plane it is linear in the ray, so interpolation is exact, and its noise is
// nearly even.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "server/environment/panorama_grid.h"
#include "server/environment/range_view.h"

namespace mixstage {

// One view from the panorama's centre: a part of the panorama, its left column may be turns away
// (PanoramaGrid::Column).
struct PanoramaPatch {
  int x0 = 0, y0 = 0;
  cv::Mat1f inverse_range;  // [h x w] 1/m, 0 = not seen
  cv::Mat1f sigma;          // [h x w] of inverse_range
};

// Draws the range picture as a surface, torn where neighbours step by more than noise and a steep slant
// explain: there each side reaches to the middle. What lies behind the view's own surface is hidden.
PanoramaPatch SeeFromCenter(const RangeView& view, const RangeCamera& camera,
                            const RigidTransform& T_world_depth, const PanoramaGrid& grid);

struct FusedDepth {
  cv::Mat1f inverse_range;  // [h x w] of the grid, 1/m, 0 = not seen
  cv::Mat1f sigma;          // [h x w] of inverse_range
  cv::Mat1b views;          // [h x w] how many agree
};

// The surface most views see, by inverse variance over those that agree within three sigma.
FusedDepth Fuse(const std::vector<PanoramaPatch>& patches, const PanoramaGrid& grid);

}  // namespace mixstage
