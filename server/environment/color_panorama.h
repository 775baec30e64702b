// SPDX-License-Identifier: Apache-2.0
//
// The sweep's colour pictures laid over the room's surface (MixIn3D 2.3): exposure and vignetting solved over
// the overlaps, seams blended.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/environment/panorama_grid.h"
#include "server/environment/surface_mesh.h"

namespace mixstage {

struct PosedPicture {
  cv::Mat3b bgr;  // sRGB, as the camera gave it
  RigidTransform T_world_color = RigidTransform::Identity();
};

// z of the surface in each view by a camera of this lens, 0 = nothing there.
Result<std::vector<cv::Mat1f>> DrawDepths(const SurfaceMesh& mesh, const PinholeCamera& camera,
                                          const std::vector<PosedPicture>& views);

// z of the nearest surface in each view's own lens at half the picture's size, taken over a few pixels
// around: what lies behind is hidden or too near an edge. 0 = nothing there.
struct ViewOcclusion {
  cv::Mat1f depth_m;
};
Result<std::vector<ViewOcclusion>> FindOcclusions(const SurfaceMesh& mesh, const PinholeCamera& camera,
                                                  const std::vector<PosedPicture>& views);

struct Photometry {
  double vignetting_a = 0, vignetting_b = 0;  // gain 1 + a r^2 + b r^4, r = 1 at the half diagonal
  std::vector<double> exposure;               // of each view; their geometric mean is 1
  double rms_levels = 0;                      // what is left between views at one point, sRGB levels
  int samples = 0;
};

// Least squares over points that several views see: each has one radiance, each view one exposure, the lens
// one vignetting. Clipped and dark pixels tell nothing. inverse_range [h x w] of the grid.
Photometry SolvePhotometry(const std::vector<PosedPicture>& views,
                           const std::vector<ViewOcclusion>& occlusions, const Rig& rig,
                           const PanoramaGrid& grid, const cv::Mat1f& inverse_range);

// Colour of every pixel with a known range that a view sees; A = 0: none does. Coarse shades are mixed over
// all views that see a point, details come from the one that sees it best: no seams, no double edges.
cv::Mat4b BlendColor(const std::vector<PosedPicture>& views, const std::vector<ViewOcclusion>& occlusions,
                     const PinholeCamera& camera, const Photometry& photometry, const PanoramaGrid& grid,
                     const cv::Mat1f& inverse_range);

}  // namespace mixstage
