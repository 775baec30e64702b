// SPDX-License-Identifier: Apache-2.0
//
// Meshes for viewers (SPEC.md 4.3) by Draco's edgebreaker.
#pragma once

#include <cstdint>
#include <vector>

#include "proto/base/result.h"
#include "server/delivery/mesh_view.h"

namespace mixstage {

// Bits of a number after quantising the box that all of an attribute's values lie in. 11 bits are 1 mm in a
// box of 2 m; 10 bits of a texture coordinate are half a pixel of a 512 wide crop.
struct DracoPrecision {
  int position_bits = 11;  // 1 .. 30
  int uv_bits = 10;
  int normal_bits = 8;
};

// Triangles of no area, and vertices that no triangle has, are left out; the order of vertices and triangles
// changes. Fails with kInternal where Draco refuses, as it does a mesh without any triangle.
Result<std::vector<std::uint8_t>> EncodeDraco(const MeshView& mesh, const DracoPrecision& precision);

}  // namespace mixstage
