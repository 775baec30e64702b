// SPDX-License-Identifier: Apache-2.0
//
// A mesh made ready for drawing, once: what is never visible is gone, one-sided and two-sided triangles are
// apart (one raster call each), textures have their mip levels, and every triangle knows its material.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "server/render/surface_key.h"
#include "server/render/texture_mips.h"
#include "server/scene/mesh.h"

namespace mixstage {

struct PreparedMesh {
  struct alignas(16) Triangle {              // never on two cache lines
    std::array<std::uint32_t, 3> corners{};  // as in indices
    std::uint32_t material = 0;
  };
  explicit PreparedMesh(std::shared_ptr<const Mesh> source);

  std::shared_ptr<const Mesh> mesh;      // positions, normals, uvs and colours are read from it
  std::vector<std::uint32_t> indices;    // first the one-sided triangles, then the two-sided
  std::size_t one_sided = 0;             // triangles
  std::vector<Triangle> triangles;       // one a triangle of indices
  std::vector<SurfaceKey> surface_keys;  // one a triangle
  std::vector<TextureMips> textures;     // as in the mesh
};

// Meshes made ready once for all who draw them; kept while anybody does. One thread at a time.
class PreparedMeshes {
 public:
  std::shared_ptr<const PreparedMesh> Get(const std::shared_ptr<const Mesh>& mesh);

 private:
  std::map<const Mesh*, std::weak_ptr<const PreparedMesh>> known_;
};

}  // namespace mixstage
