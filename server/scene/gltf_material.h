// SPDX-License-Identifier: Apache-2.0
//
// Materials of a glTF model, as far as MixStage draws them: base colour factor and texture, metallic,
// roughness, alpha mask, double-sidedness. Other textures (normal, occlusion, emission) are left out, with a
// warning.
#pragma once

#include <tiny_gltf.h>
#include <cstdint>
#include <string>
#include <vector>

#include "server/scene/mesh.h"

namespace mixstage {

// KHR_texture_transform of a material's base colour: uv' = offset + R(rotation) scale uv; applied to the
// vertices.
struct TextureTransform {
  int uv_set = 0;  // TEXCOORD_n
  Eigen::Vector2f offset = Eigen::Vector2f::Zero(), scale = Eigen::Vector2f::Ones();
  float rotation_rad = 0;
  [[nodiscard]] Eigen::Vector2f Apply(const Eigen::Vector2f& uv) const;
};

struct GltfMaterials {
  std::vector<Material> materials;  // one more than the file has: the last is glTF's default material
  std::vector<TextureTransform> transforms;
  std::vector<Texture> textures;
};

// encoded_images: the bytes of the images that came by uri (empty: in a buffer view, or not found). A picture
// that cannot be used is a warning; the material is then drawn by its factor alone.
GltfMaterials ReadGltfMaterials(const tinygltf::Model& model,
                                const std::vector<std::vector<std::uint8_t>>& encoded_images,
                                std::vector<std::string>& warnings);

}  // namespace mixstage
