// SPDX-License-Identifier: Apache-2.0
//
// The room's surface as triangles (MixIn3D 2.3; algorithms 4): a grid over the panorama, cut at depth edges,
// reduced until what is left cannot be seen.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "server/environment/dense_surface.h"

namespace mixstage {

struct SurfaceMeshConfig {
  double cut_m = 0.1;  // least step that is an edge
  std::size_t most_triangles = 150'000;
  double error =
      3e-4;  // radians that an edge may move; a twentieth of it of range, relative; 0 = nothing reduced
};

struct SurfaceMesh {
  std::vector<Eigen::Vector3f> positions;  // world
  std::vector<Eigen::Vector2f> uvs;        // of the panorama, v down
  std::vector<std::uint32_t> indices;      // counter-clockwise seen from the panorama's centre
};

// A cell whose corners lie on several surfaces ends the nearest in its middle and fills it
// with the farthest. Corners are reduced in the space of column, row and log of range: there a triangle that
// stays within `error` keeps its place, its range and its place in the texture at once, which three
// dimensions alone would not (a wall is flat, the texture on it is not).
SurfaceMesh MakeSurfaceMesh(const DenseSurface& dense, const SurfaceNodes& nodes, const PanoramaGrid& grid,
                            const SurfaceMeshConfig& config);

}  // namespace mixstage
