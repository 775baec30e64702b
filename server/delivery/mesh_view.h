// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>

namespace mixstage {

// A borrowed triangle mesh on its way out. Lists but positions and indices may be empty; else they have one
// entry for each position. Held by whoever makes one: finite numbers, whole triangles, indices below
// positions.size().
struct MeshView {
  std::span<const Eigen::Vector3f> positions{};           // metres
  std::span<const Eigen::Vector2f> uvs{};                 // 0..1, v down
  std::span<const Eigen::Vector3f> normals{};             // of length 1
  std::span<const std::array<std::uint8_t, 3>> colors{};  // sRGB
  std::span<const std::uint32_t> indices{};               // counter-clockwise = seen from outside
};

}  // namespace mixstage
