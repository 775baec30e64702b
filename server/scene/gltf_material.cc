// SPDX-License-Identifier: Apache-2.0
#include "server/scene/gltf_material.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "server/scene/gltf_accessor.h"
#include "server/scene/texture_file.h"

namespace mixstage {
namespace {

float Unit(double value, float otherwise) {
  return std::isfinite(value) ? static_cast<float>(std::clamp(value, 0.0, 1.0)) : otherwise;
}

TextureWrap Wrap(int code) {
  if (code == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return TextureWrap::kClamp;
  if (code == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT) return TextureWrap::kMirror;
  return TextureWrap::kRepeat;
}

// Member of an extension's object as a finite number; null values and other types give the default.
float Number(const tinygltf::Value& value, float otherwise) {
  if (!value.IsNumber()) return otherwise;
  const double number = value.GetNumberAsDouble();
  return std::isfinite(number) && std::abs(number) < 1e6 ? static_cast<float>(number) : otherwise;
}
Eigen::Vector2f Pair(const tinygltf::Value& value, const Eigen::Vector2f& otherwise) {
  if (!value.IsArray() || value.ArrayLen() != 2) return otherwise;
  return {Number(value.Get(0), otherwise.x()), Number(value.Get(1), otherwise.y())};
}

TextureTransform ReadTransform(const tinygltf::TextureInfo& info) {
  TextureTransform transform;
  transform.uv_set = std::clamp(info.texCoord, 0, 7);
  const auto found = info.extensions.find("KHR_texture_transform");
  if (found == info.extensions.end() || !found->second.IsObject()) return transform;
  const tinygltf::Value& value = found->second;
  transform.offset = Pair(value.Get("offset"), transform.offset);
  transform.scale = Pair(value.Get("scale"), transform.scale);
  transform.rotation_rad = Number(value.Get("rotation"), 0);
  transform.uv_set = static_cast<int>(
      std::clamp(Number(value.Get("texCoord"), static_cast<float>(transform.uv_set)), 0.0f, 7.0f));
  return transform;
}

// Decodes each image once; textures with the same image share its pixels.
class Images {
 public:
  Images(const tinygltf::Model& model, const std::vector<std::vector<std::uint8_t>>& encoded)
      : model_(model), encoded_(encoded) {}

  Result<cv::Mat4b> Get(int source) {
    if (source < 0 || static_cast<std::size_t>(source) >= model_.images.size()) {
      return Fail(ErrorCode::kBadInput, "does not exist");
    }
    const auto index = static_cast<std::size_t>(source);
    if (const auto known = decoded_.find(index); known != decoded_.end()) return known->second;
    std::span<const std::uint8_t> bytes;
    if (model_.images[index].bufferView >= 0) {
      auto view = GltfViewBytes(model_, model_.images[index].bufferView);
      if (!view) return tl::unexpected(view.error());
      bytes = *view;
    } else if (index < encoded_.size()) {
      bytes = encoded_[index];
    }
    if (bytes.empty()) return Fail(ErrorCode::kBadInput, "is missing");
    auto picture = DecodeTexture(bytes, remaining_pixels_);
    if (picture) decoded_[index] = *picture;
    return picture;
  }

 private:
  const tinygltf::Model& model_;
  const std::vector<std::vector<std::uint8_t>>& encoded_;
  std::map<std::size_t, cv::Mat4b> decoded_;
  std::size_t remaining_pixels_ = ModelLimits::kTexturePixels;
};

Result<Texture> ReadTexture(const tinygltf::Model& model, int index, Images& images) {
  if (static_cast<std::size_t>(index) >= model.textures.size()) {
    return Fail(ErrorCode::kBadInput, "textures[" + std::to_string(index) + "] does not exist");
  }
  const tinygltf::Texture& source = model.textures[static_cast<std::size_t>(index)];
  auto picture = images.Get(source.source);
  if (!picture) return Within("images[" + std::to_string(source.source) + "]", picture.error());
  Texture texture;
  texture.rgba = *picture;
  if (source.sampler >= 0 && static_cast<std::size_t>(source.sampler) < model.samplers.size()) {
    const tinygltf::Sampler& sampler = model.samplers[static_cast<std::size_t>(source.sampler)];
    texture.wrap_u = Wrap(sampler.wrapS);
    texture.wrap_v = Wrap(sampler.wrapT);
  }
  return texture;
}

Material ReadFactors(const tinygltf::Material& source) {
  const tinygltf::PbrMetallicRoughness& pbr = source.pbrMetallicRoughness;
  Material material;
  material.name = source.name.substr(0, 128);
  if (pbr.baseColorFactor.size() == 4) {
    for (std::size_t c = 0; c < 3; ++c)
      material.base_color[static_cast<int>(c)] = Unit(pbr.baseColorFactor[c], 1);
    material.base_alpha = Unit(pbr.baseColorFactor[3], 1);
  }
  material.metallic = Unit(pbr.metallicFactor, 1);
  material.roughness = Unit(pbr.roughnessFactor, 1);
  material.double_sided = source.doubleSided;
  // Blended surfaces would need sorting: what is more than half there is drawn, the rest is not.
  material.alpha_mask = source.alphaMode == "MASK" || source.alphaMode == "BLEND";
  material.alpha_cutoff = source.alphaMode == "MASK" ? Unit(source.alphaCutoff, 0.5f) : 0.5f;
  return material;
}

}  // namespace

Eigen::Vector2f TextureTransform::Apply(const Eigen::Vector2f& uv) const {
  const Eigen::Vector2f s = scale.cwiseProduct(uv);
  const float cosine = std::cos(rotation_rad);
  const float sine = std::sin(rotation_rad);
  return {offset.x() + cosine * s.x() + sine * s.y(), offset.y() - sine * s.x() + cosine * s.y()};
}

GltfMaterials ReadGltfMaterials(const tinygltf::Model& model,
                                const std::vector<std::vector<std::uint8_t>>& encoded_images,
                                std::vector<std::string>& warnings) {
  GltfMaterials read;
  Images images(model, encoded_images);
  std::map<int, int> texture_of_index;
  bool extra_textures = false;
  for (std::size_t i = 0; i < model.materials.size(); ++i) {
    const tinygltf::Material& source = model.materials[i];
    Material material = ReadFactors(source);
    const tinygltf::TextureInfo& info = source.pbrMetallicRoughness.baseColorTexture;
    extra_textures |= source.normalTexture.index >= 0 || source.emissiveTexture.index >= 0 ||
                      source.pbrMetallicRoughness.metallicRoughnessTexture.index >= 0;
    // The factor of a metallic texture is 1 by default and means nothing without the texture.
    if (source.pbrMetallicRoughness.metallicRoughnessTexture.index >= 0) material.metallic = 0;
    if (info.index >= 0) {
      auto [known, is_new] = texture_of_index.try_emplace(info.index, -1);
      if (is_new) {
        if (auto texture = ReadTexture(model, info.index, images)) {
          known->second = static_cast<int>(read.textures.size());
          read.textures.push_back(std::move(*texture));
        } else {
          warnings.push_back("materials[" + std::to_string(i) +
                             "] is drawn without its texture: " + texture.error().message);
        }
      }
      material.texture = known->second;
    }
    read.materials.push_back(std::move(material));
    read.transforms.push_back(ReadTransform(info));
  }
  if (extra_textures) warnings.emplace_back("normal, metallic-roughness and emission textures are not drawn");
  Material standard;
  standard.name = "default";
  standard.double_sided = false;
  read.materials.push_back(standard);
  read.transforms.emplace_back();
  return read;
}

}  // namespace mixstage
