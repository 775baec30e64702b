// SPDX-License-Identifier: Apache-2.0
#include "server/scene/vertex_colors.h"

#include <algorithm>
#include <cmath>

#include "proto/base/srgb.h"

namespace mixstage {
namespace {

std::uint8_t CodeOf(float linear) {
  return static_cast<std::uint8_t>(255 * SrgbOfLinear(std::clamp(linear, 0.0f, 1.0f)) + 0.5f);
}

// Texel of a column or row anywhere beside the picture.
int Wrapped(std::int64_t texel, int size, TextureWrap wrap) {
  switch (wrap) {
    case TextureWrap::kRepeat:
      break;
    case TextureWrap::kClamp:
      return static_cast<int>(std::clamp<std::int64_t>(texel, 0, size - 1));
    case TextureWrap::kMirror: {
      const std::int64_t period = 2 * static_cast<std::int64_t>(size);
      const std::int64_t place = ((texel % period) + period) % period;
      return static_cast<int>(place < size ? place : period - 1 - place);
    }
  }
  return static_cast<int>(((texel % size) + size) % size);
}

Eigen::Vector3f Sample(const Texture& texture, const Eigen::Vector2f& uv) {
  constexpr float kFarthest = 1e6f;  // pictures from the origin: beyond it a float has no texel
  const int width = texture.rgba.cols, height = texture.rgba.rows;
  const float x = std::clamp(uv.x(), -kFarthest, kFarthest) * static_cast<float>(width) - 0.5f;
  const float y = std::clamp(uv.y(), -kFarthest, kFarthest) * static_cast<float>(height) - 0.5f;
  const float left = std::floor(x), top = std::floor(y);
  const SrgbTables& srgb = SrgbTables::Get();
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  for (int corner = 0; corner < 4; ++corner) {
    const int dx = corner & 1, dy = corner >> 1;
    const float weight = (dx == 1 ? x - left : left + 1 - x) * (dy == 1 ? y - top : top + 1 - y);
    const cv::Vec4b& texel =
        texture.rgba(Wrapped(static_cast<std::int64_t>(top) + dy, height, texture.wrap_v),
                     Wrapped(static_cast<std::int64_t>(left) + dx, width, texture.wrap_u));
    sum +=
        weight * Eigen::Vector3f(srgb.ToLinear(texel[0]), srgb.ToLinear(texel[1]), srgb.ToLinear(texel[2]));
  }
  return sum;
}

}  // namespace

std::vector<std::array<std::uint8_t, 3>> BakeVertexColors(const Mesh& mesh) {
  std::vector<std::array<std::uint8_t, 3>> baked(mesh.positions.size(), {255, 255, 255});
  std::vector<bool> done(mesh.positions.size());
  for (const MeshPart& part : mesh.parts) {
    const Material& material = mesh.materials[static_cast<std::size_t>(part.material)];
    for (std::size_t i = part.first_index; i < part.first_index + part.index_count; ++i) {
      const std::uint32_t v = mesh.indices[i];
      if (done[v]) continue;
      done[v] = true;
      Eigen::Vector3f color = material.base_color;
      if (!mesh.colors.empty()) color = color.cwiseProduct(mesh.colors[v]);
      if (material.texture >= 0 && !mesh.uvs.empty()) {
        color = color.cwiseProduct(
            Sample(mesh.textures[static_cast<std::size_t>(material.texture)], mesh.uvs[v]));
      }
      for (std::size_t c = 0; c < 3; ++c) baked[v][c] = CodeOf(color[static_cast<Eigen::Index>(c)]);
    }
  }
  return baked;
}

}  // namespace mixstage
