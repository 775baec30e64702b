// SPDX-License-Identifier: Apache-2.0
//
// Meshes that move as a whole.
#pragma once

#include <memory>
#include <string>
#include <utility>

#include "server/scene/mesh.h"

namespace mixstage::test {

// A clip whose first node goes from its place to `by` at an even speed.
inline MotionClip Going(std::string name, float duration_s, const Eigen::Vector3f& by) {
  MotionTrack track;
  track.times_s = {0, duration_s};
  track.values = {0, 0, 0, by.x(), by.y(), by.z()};
  return {std::move(name), duration_s, {track}};
}

// "go": 4 along x in 2 s; "rise": 1 along z in 1 s.
inline std::shared_ptr<const Mesh> Moving(Mesh mesh) {
  auto motion = std::make_shared<MeshMotion>();
  motion->nodes.resize(1);
  motion->bones.resize(1);
  motion->vertices.resize(mesh.positions.size());
  motion->bind_positions = mesh.positions;
  motion->bind_normals = mesh.normals;
  motion->clips = {Going("go", 2, {4, 0, 0}), Going("rise", 1, {0, 0, 1})};
  mesh.motion = std::move(motion);
  return std::make_shared<const Mesh>(std::move(mesh));
}

}  // namespace mixstage::test
