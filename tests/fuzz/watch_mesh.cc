// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "proto/base/check.h"
#include "proto/watch/mesh_message.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace mixstage;
  const auto mesh = ReadWatchMesh({data, size});
  if (!mesh) return 0;
  for (const auto part : {mesh->mesh, mesh->texture}) {
    MIX_CHECK(part.empty() || (part.data() >= data && part.data() + part.size() <= data + size));
  }
  const auto again = WriteWatchMesh(*mesh);
  const auto same = ReadWatchMesh(again);
  MIX_CHECK(same && same->stream == mesh->stream && same->id == mesh->id);
  MIX_CHECK(std::ranges::equal(same->mesh, mesh->mesh) && std::ranges::equal(same->texture, mesh->texture));
  return 0;
}
