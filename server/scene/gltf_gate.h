// SPDX-License-Identifier: Apache-2.0
//
// What a glTF file must satisfy before tinygltf may see it: the container, the size and depth of its JSON,
// the extensions it insists on, and what its buffers and pictures together ask for. tinygltf checks none of
// these.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

enum class GltfContainer {
  kBinary = 1,  // .glb
  kText,        // .gltf
};

// Fails with one line that names the field. The container is told by the bytes, not by the file's name.
Result<GltfContainer> CheckGltf(const std::vector<std::uint8_t>& bytes);

}  // namespace mixstage
