// SPDX-License-Identifier: Apache-2.0
#include "server/scene/model_wire.h"

#include <cstring>
#include <span>

#include "proto/base/check.h"
#include "tests/fuzz/mesh_poses.h"

// What an importer that a hostile file has taken over may say: a good mesh, or an error.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  std::span<const std::uint8_t> left(data, size);
  const auto model = ReadModel([&](void* bytes, std::size_t count) {
    if (count > left.size()) return false;
    std::memcpy(bytes, left.data(), count);
    left = left.subspan(count);
    return true;
  });
  if (!model) return 0;
  MIX_CHECK(CheckMesh(model->mesh).has_value());
  CheckPoses(model->mesh);
  return 0;
}
