// SPDX-License-Identifier: Apache-2.0
#include "server/render/cg_fragments.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "server/render/interpolate.h"

namespace mixstage {
namespace {

constexpr float kDielectric = 0.04f;  // what glass, paint or skin mirror head-on

// Finds a triangle's object; the same as last time more often than not.
class ObjectFinder {
 public:
  explicit ObjectFinder(const CameraScene& scene) : scene_(scene) {}
  const CameraObject& Find(std::int32_t triangle) {
    const auto id = static_cast<std::size_t>(triangle);
    if (object_ == nullptr || id < object_->first_triangle || id >= last_) {
      object_ = &scene_.ObjectOf(id);
      last_ = object_->first_triangle + object_->mesh->triangles.size();
    }
    return *object_;
  }

 private:
  const CameraScene& scene_;
  const CameraObject* object_ = nullptr;
  std::size_t last_ = 0;  // one past the object's triangles
};

// Two triangles in one pixel are one surface when light falls on them alike: same material, normals within
// about 18 degrees.
bool SameSurface(const PreparedMesh::Triangle& a, const PreparedMesh::Triangle& b) {
  constexpr float kCosine = 0.95f;
  return a.material == b.material && a.normal.dot(b.normal) > kCosine;
}

// Blinn-Phong's exponent for a roughness: 2 / roughness^4 - 2, kept where four samples a pixel can show it.
float Shininess(float roughness) {
  const float alpha = roughness * roughness;
  return std::clamp(2.0f / std::max(alpha * alpha, 1e-4f) - 2.0f, 1.0f, 256.0f);
}

}  // namespace

void FragmentShader::ShadeRow(const FragmentSource& source, int v, CgLayer& layer) {
  const int row = v - layer.bounds.y;
  const auto width = static_cast<std::size_t>(layer.bounds.width);
  std::memset(layer.color.ptr(row), 0, width * sizeof(cv::Vec4f));
  std::memset(layer.depth_m.ptr(row), 0, width * sizeof(float));
  std::memset(layer.object_id.ptr(row), 0, width);
  Collect(source, v, layer);
  if (fragments_.empty()) return;
  Fetch(source.scene);
  const std::size_t count = fragments_.size();
  Interpolate(source.pixel_rad, count, rows_);
  ShadeLights(source.light, count, rows_);
  SampleTextures(textures_, rows_, texture_rgba_.data());
  Resolve(row, layer);
}

void FragmentShader::Collect(const FragmentSource& source, int v, const CgLayer& layer) {
  fragments_.clear();
  const int grid_y = kSampleScale * (v - source.region_px.y);
  const int grid_x = kSampleScale * (layer.bounds.x - source.region_px.x);
  const std::int32_t* above = source.samples.triangle.ptr<std::int32_t>(grid_y) + grid_x;
  const std::int32_t* below = source.samples.triangle.ptr<std::int32_t>(grid_y + 1) + grid_x;
  const auto* rays = source.rays.ptr<cv::Vec2f>(v) + layer.bounds.x;
  for (int column = 0; column < layer.bounds.width; ++column, above += kSampleScale, below += kSampleScale) {
    const std::int32_t ids[4] = {above[0], above[1], below[0], below[1]};
    if ((ids[0] & ids[1] & ids[2] & ids[3]) == -1) continue;  // all are -1: nothing
    const cv::Vec2f& ray = rays[column];
    if (ids[0] == ids[1] && ids[0] == ids[2] && ids[0] == ids[3]) {
      fragments_.push_back({ids[0], column, ray[0], ray[1], 1.0f});
    } else {
      CollectMixed(source.scene, ids, ray, source.pixel_rad, column);
    }
  }
}

// Samples of different triangles: those of one surface become one fragment, shaded in their middle.
void FragmentShader::CollectMixed(const CameraScene& scene, const std::int32_t (&ids)[4],
                                  const cv::Vec2f& ray, float pixel_rad, int column) {
  constexpr float kOffsetX[4] = {-0.25f, 0.25f, -0.25f, 0.25f};
  constexpr float kOffsetY[4] = {-0.25f, -0.25f, 0.25f, 0.25f};
  ObjectFinder finder(scene);
  unsigned left = 0;  // bit i: sample i shows something and has no fragment yet
  for (unsigned i = 0; i < 4; ++i) left |= ids[i] >= 0 ? 1u << i : 0u;
  while (left != 0) {
    const auto first = static_cast<unsigned>(std::countr_zero(left));
    const CameraObject& object = finder.Find(ids[first]);
    auto triangle_of = [&](std::int32_t id) -> const PreparedMesh::Triangle& {
      return object.mesh->triangles[static_cast<std::size_t>(id) - object.first_triangle];
    };
    const PreparedMesh::Triangle& triangle = triangle_of(ids[first]);
    float x = 0;
    float y = 0;
    float count = 0;
    for (unsigned i = first; i < 4; ++i) {
      if ((left & 1u << i) == 0) continue;
      const bool same = ids[i] == ids[first] ||
                        (&finder.Find(ids[i]) == &object && SameSurface(triangle_of(ids[i]), triangle));
      if (!same) continue;
      left &= ~(1u << i);
      x += kOffsetX[i];
      y += kOffsetY[i];
      count += 1;
    }
    const float scale = pixel_rad / count;
    fragments_.push_back({ids[first], column, ray[0] + scale * x, ray[1] + scale * y, 0.25f * count});
  }
}

// Brings together, in rows, what the kernels read.
void FragmentShader::Fetch(const CameraScene& scene) {
  const std::size_t count = fragments_.size();
  if (count > rows_.capacity()) {
    rows_.Resize(count);
    texture_rgba_.resize(4 * rows_.capacity());
    looks_.reserve(rows_.capacity());
    textures_.reserve(rows_.capacity());
  }
  looks_.resize(count);
  textures_.resize(count);
  using enum FragmentRows::Row;
  float* corners[6];
  for (std::size_t block = 0; block < 6; ++block) corners[block] = rows_.corner(block);
  float* ray_x = rows_.row(kRayX);
  float* ray_y = rows_.row(kRayY);
  float* front = rows_.row(kFront);
  float* width = rows_.row(kTextureWidth);
  float* height = rows_.row(kTextureHeight);
  float* shininess = rows_.row(kShininess);
  ObjectFinder finder(scene);
  const Material* material = nullptr;
  float material_shininess = 1;
  for (std::size_t i = 0; i < count; ++i) {
    const Fragment& fragment = fragments_[i];
    const CameraObject& object = finder.Find(fragment.triangle);
    const PreparedMesh& prepared = *object.mesh;
    const std::size_t t = static_cast<std::size_t>(fragment.triangle) - object.first_triangle;
    const std::uint32_t* corner = &prepared.indices[3 * t];
    const CameraVertex* vertices = scene.vertices().data() + object.first_vertex;
    for (std::size_t k = 0; k < 3; ++k) {
      const CameraVertex& vertex = vertices[corner[k]];
      Eigen::Map<Eigen::Array4f>(corners[k] + 4 * i) = vertex.position_u;
      Eigen::Map<Eigen::Array4f>(corners[k + 3] + 4 * i) = vertex.normal_v;
    }
    const Material* its_material = &prepared.mesh->materials[prepared.triangles[t].material];
    if (its_material != material) {
      material = its_material;
      material_shininess = Shininess(material->roughness);
    }
    const bool textured = material->texture >= 0 && !prepared.mesh->uvs.empty();
    textures_[i] = textured ? &prepared.textures[static_cast<std::size_t>(material->texture)] : nullptr;
    width[i] = textured ? static_cast<float>(textures_[i]->levels()[0].width) : 0.0f;
    height[i] = textured ? static_cast<float>(textures_[i]->levels()[0].height) : 0.0f;
    looks_[i] = {prepared.mesh.get(), material, corner, object.index};
    ray_x[i] = fragment.ray_x;
    ray_y[i] = fragment.ray_y;
    front[i] = object.mirrored ? -1.0f : 1.0f;
    shininess[i] = material_shininess;
  }
}

void FragmentShader::Resolve(int row, CgLayer& layer) const {
  using enum FragmentRows::Row;
  auto* color_row = layer.color.ptr<cv::Vec4f>(row);
  float* depth_row = layer.depth_m.ptr<float>(row);
  std::uint8_t* id_row = layer.object_id.ptr<std::uint8_t>(row);
  const float* diffuse[3] = {rows_.row(kDiffuseR), rows_.row(kDiffuseG), rows_.row(kDiffuseB)};
  const float* specular[3] = {rows_.row(kSpecularR), rows_.row(kSpecularG), rows_.row(kSpecularB)};
  const float* z = rows_.row(kZ);
  for (std::size_t i = 0; i < fragments_.size(); ++i) {
    const Fragment& fragment = fragments_[i];
    const Look& look = looks_[i];
    const Material& material = *look.material;
    const float* texel = &texture_rgba_[4 * i];
    Eigen::Vector3f base = material.base_color;
    if (!look.mesh->colors.empty()) {
      const std::vector<Eigen::Vector3f>& colors = look.mesh->colors;
      const float b = rows_.row(kWeight1)[i];
      const float c = rows_.row(kWeight2)[i];
      base = base.cwiseProduct((1 - b - c) * colors[look.corners[0]] + b * colors[look.corners[1]] +
                               c * colors[look.corners[2]]);
    }
    float coverage = fragment.weight;
    // The cut-off is a ramp of a few grey levels, so that the edge inside a pixel is soft.
    if (material.alpha_mask) {
      const float alpha = material.base_alpha * texel[3];
      coverage *= std::clamp(0.5f + 4.0f * (alpha - material.alpha_cutoff), 0.0f, 1.0f);
    }
    if (!(coverage > 0)) continue;
    float* out = color_row[fragment.column].val;
    for (int c = 0; c < 3; ++c) {
      const float albedo = base[c] * texel[c];
      const float mirror = kDielectric + material.metallic * (albedo - kDielectric);
      out[c] += coverage * ((1.0f - material.metallic) * albedo * diffuse[c][i] + mirror * specular[c][i]);
    }
    out[3] += coverage;
    float& nearest = depth_row[fragment.column];
    if (nearest == 0 || z[i] < nearest) {
      nearest = z[i];
      id_row[fragment.column] = static_cast<std::uint8_t>(std::min(look.object_index + 1, 255));
    }
  }
}

}  // namespace mixstage
