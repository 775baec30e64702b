// SPDX-License-Identifier: Apache-2.0
//
// Triangles that the scan cannot take as they are: across the near plane, or so large that the lens bends
// their edges.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "server/raster/projected_vertex.h"
#include "server/raster/raster_lens.h"

namespace mixstage::raster {

struct CameraCorner {
  Eigen::Vector3f p_camera = Eigen::Vector3f::Zero();
  ProjectedVertex projected;
};

// What came out: triangle i has corners vertices[3 i + 0..2] and id ids[i].
struct SplitTriangles {
  std::vector<ProjectedVertex> vertices;
  std::vector<std::uint32_t> indices;  // 0, 1, 2, ...
  std::vector<std::int32_t> ids;
  void Clear() { vertices.clear(), indices.clear(), ids.clear(); }
};

// Appends the parts of the triangle a b c that may be seen inside the clip (its x0..y1 alone are used),
// orientation kept, every edge at most lens.max_edge long. Whether and where an edge is halved depends on its
// own two ends alone, so neighbours agree and no gap opens between them. Parts beyond the lens's fold are
// left out.
void SplitTriangle(const RasterLens& lens, const CameraCorner& a, const CameraCorner& b,
                   const CameraCorner& c, std::int32_t id, const ScanTarget& clip, SplitTriangles& out);

}  // namespace mixstage::raster
