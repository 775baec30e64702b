// SPDX-License-Identifier: Apache-2.0
//
// Meshes as files for other programs.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "server/delivery/mesh_view.h"

namespace mixstage {

// glTF 2.0 binary: one mesh, not lit, its JPEG embedded (empty: none). `mesh` is z up as the world is; a node
// turns it to glTF's y up. Normals and colours are left out. At least one triangle (checked); texture and
// mesh together less than 2 GiB.
[[nodiscard]] std::vector<std::uint8_t> WriteGlb(const MeshView& mesh, std::span<const std::uint8_t> jpeg);

// PLY 1.0, binary little-endian: x y z, red green blue where there are colours, triangles. Coordinates as
// they are.
[[nodiscard]] std::vector<std::uint8_t> WritePly(const MeshView& mesh);

}  // namespace mixstage
