// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "server/scene/mesh.h"

namespace mixstage {

// The look of a model without its pictures: base colour times vertex colour times the texture at the vertex
// (bilinear, in linear light), 8-bit sRGB, one for each vertex. A vertex that parts of several materials
// share has the first one's; one that no part uses is white. Coverage and light are left out.
[[nodiscard]] std::vector<std::array<std::uint8_t, 3>> BakeVertexColors(const Mesh& mesh);

}  // namespace mixstage
