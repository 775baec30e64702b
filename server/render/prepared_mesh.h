// SPDX-License-Identifier: Apache-2.0
//
// A mesh made ready for drawing, once: what is never visible is gone, one-sided and two-sided triangles are
// apart (one raster call each), textures have their mip levels, and every triangle knows how fine its texture
// lies on it.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "server/render/texture_mips.h"
#include "server/scene/mesh.h"

namespace mixstage {

struct PreparedMesh {
  struct Triangle {
    Eigen::Vector3f normal;      // mean of its corners' normals (not of length 1): where shading bends
    float texels_per_metre = 0;  // of level 0 along the texture's denser direction, object frame
    std::uint32_t material = 0;
  };

  explicit PreparedMesh(std::shared_ptr<const Mesh> source);

  std::shared_ptr<const Mesh> mesh;    // positions, normals, uvs and colours are read from it
  std::vector<std::uint32_t> indices;  // first the one-sided triangles, then the two-sided
  std::size_t one_sided = 0;           // triangles
  std::vector<Triangle> triangles;     // one a triangle of indices
  std::vector<TextureMips> textures;   // as in the mesh
};

}  // namespace mixstage
