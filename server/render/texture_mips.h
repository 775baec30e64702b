// SPDX-License-Identifier: Apache-2.0
//
// A texture as it is sampled: linear light, 16 bits a channel, and all its halvings (mip levels), so that a
// texture that is seen small is averaged instead of picked from.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "server/render/fragment_rows.h"
#include "server/scene/mesh.h"

namespace mixstage {

class TextureMips {
 public:
  // One border texel all around continues the texture as its wrap mode says: a sample's four neighbours lie
  // side by side, whatever its place.
  struct Level {
    const std::uint16_t* corner = nullptr;  // R G B A (65535 = 1.0) of texel (-1, -1)
    int width = 0, height = 0;              // texels without the border
    int stride = 0;                         // texels from a row to the next
    [[nodiscard]] const std::uint16_t* texel(int x, int y) const {
      return corner + 4 * (static_cast<std::ptrdiff_t>(y + 1) * stride + x + 1);
    }
  };

  // The levels once more, a number an array, for vectors of fragments that each look up their own level.
  static constexpr std::size_t kMostLevels = 14;  // 8192 .. 1
  struct LevelTable {
    std::array<float, kMostLevels> width{}, height{};
    std::array<std::int32_t, kMostLevels> first{};  // texels from texels() to the level's corner
    std::array<std::int32_t, kMostLevels> stride{};
  };

  // No picture of ours shows more of one object.
  static constexpr int kLargestSide = 4096;  // px
  // A side over largest_side px (at most 8192) is halved first.
  explicit TextureMips(const Texture& texture, int largest_side = kLargestSide);

  [[nodiscard]] std::span<const Level> levels() const { return levels_; }
  [[nodiscard]] const LevelTable& table() const { return table_; }
  [[nodiscard]] const std::uint16_t* texels() const { return texels_.ptr<std::uint16_t>(0); }
  [[nodiscard]] std::size_t texel_count() const { return texels_.total(); }
  [[nodiscard]] TextureWrap wrap_u() const { return wrap_u_; }
  [[nodiscard]] TextureWrap wrap_v() const { return wrap_v_; }

  // R G B (linear) and alpha, all 0..1, at one point: between texels and between two levels blended
  // (trilinear). texels: length in level 0 that the sample stands for.
  [[nodiscard]] Eigen::Array4f Sample(float u, float v, float texels) const;

 private:
  cv::Mat4w texels_;  // [1 x n] all levels with their borders, one after the other
  std::vector<Level> levels_;
  LevelTable table_;
  TextureWrap wrap_u_, wrap_v_;
};

// Colours of fragments 0..count-1 (four floats each, R G B A): the mean of kTaps samples along the
// footprint's longer axis. textures: one a fragment; nullptr gives 1 1 1 1. The scalar one is the
// specification.
void SampleTextures(std::span<const TextureMips* const> textures, const FragmentRows& rows, float* rgba);
void SampleTexturesScalar(std::span<const TextureMips* const> textures, const FragmentRows& rows,
                          float* rgba);

}  // namespace mixstage
