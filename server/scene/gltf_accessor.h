// SPDX-License-Identifier: Apache-2.0
//
// Numbers out of a glTF model's accessors; every offset, stride and count is checked against the buffer
// first.
#pragma once

#include <tiny_gltf.h>
#include <cstdint>
#include <span>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

// The bytes of a buffer view; fails when it lies outside its buffer.
Result<std::span<const std::uint8_t>> GltfViewBytes(const tinygltf::Model& model, int buffer_view);

// count x components numbers of an accessor; integers that are marked normalised become 0..1 or -1..1, others
// their value. components: what the caller can take ({3} for positions, {3, 4} for colours, {16} for
// matrices); the accessor's own number is returned beside the values. Sparse accessors are filled in.
struct GltfNumbers {
  std::vector<float> values;
  int components = 0;
  [[nodiscard]] std::size_t count() const { return values.size() / static_cast<std::size_t>(components); }
};
Result<GltfNumbers> ReadGltfNumbers(const tinygltf::Model& model, int accessor,
                                    std::initializer_list<int> components);

// The vertex indices of an accessor of unsigned scalars, each < vertex_count.
Result<std::vector<std::uint32_t>> ReadGltfIndices(const tinygltf::Model& model, int accessor,
                                                   std::size_t vertex_count);

}  // namespace mixstage
