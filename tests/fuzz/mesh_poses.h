// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

#include "proto/base/check.h"
#include "server/scene/mesh.h"

namespace mixstage {

// Whatever moves a good mesh, it stays one.
inline void CheckPoses(const Mesh& mesh) {
  if (mesh.motion == nullptr) return;
  const auto finite = [](const Eigen::Vector3f& v) { return v.allFinite(); };
  for (const int clip : {-1, 0, static_cast<int>(mesh.motion->clips.size()) - 1}) {
    const float end_s = clip < 0 ? 0 : mesh.motion->clips[static_cast<std::size_t>(clip)].duration_s;
    for (const float part : {0.0f, 0.3f, 1.0f}) {
      const PosedVertices posed = PoseMesh(*mesh.motion, clip, part * end_s);
      MIX_CHECK(posed.positions.size() == mesh.positions.size());
      MIX_CHECK(posed.normals.size() == mesh.positions.size());
      MIX_CHECK(std::ranges::all_of(posed.positions, finite) && std::ranges::all_of(posed.normals, finite));
    }
  }
}

}  // namespace mixstage
