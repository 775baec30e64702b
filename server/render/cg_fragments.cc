// SPDX-License-Identifier: Apache-2.0
#include "server/render/cg_fragments.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "server/render/interpolate.h"
#include "server/render/surface_color.h"

namespace mixstage {
namespace {

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

const PreparedMesh::Triangle& TriangleOf(const CameraObject& object, std::int32_t id) {
  return object.mesh->triangles[static_cast<std::size_t>(id) - object.first_triangle];
}

SurfaceKey KeyOf(const CameraObject& object, std::int32_t id) {
  return object.mesh->surface_keys[static_cast<std::size_t>(id) - object.first_triangle];
}

// All four samples show one surface. Where triangles are small most pixels hold several and nearly all end
// here: nothing to guess before the last branch.
bool AreOneSurface(ObjectFinder& finder, const std::int32_t (&ids)[4]) {
  if ((ids[0] | ids[1] | ids[2] | ids[3]) < 0) return false;  // one is -1: nothing
  const CameraObject& object = finder.Find(ids[0]);
  const std::size_t triangles = object.mesh->triangles.size();
  auto of_object = [&](std::int32_t id) -> unsigned {
    return static_cast<std::size_t>(id) - object.first_triangle < triangles ? 1 : 0;
  };
  if ((of_object(ids[1]) & of_object(ids[2]) & of_object(ids[3])) == 0) return false;
  return SurfaceKey::AreOne(KeyOf(object, ids[0]), KeyOf(object, ids[1]), KeyOf(object, ids[2]),
                            KeyOf(object, ids[3]));
}

// Samples of several surfaces: those of one become one fragment, shaded in their middle.
template <typename AddFragment>
void SplitPixel(ObjectFinder& finder, const std::int32_t (&ids)[4], AddFragment add) {
  constexpr float kOffsetX[4] = {-0.25f, 0.25f, -0.25f, 0.25f};
  constexpr float kOffsetY[4] = {-0.25f, -0.25f, 0.25f, 0.25f};
  unsigned left = 0;  // bit i: sample i shows something and has no fragment yet
  for (unsigned i = 0; i < 4; ++i) left |= ids[i] >= 0 ? 1u << i : 0u;
  while (left != 0) {
    const auto first = static_cast<unsigned>(std::countr_zero(left));
    const CameraObject& object = finder.Find(ids[first]);
    const SurfaceKey key = KeyOf(object, ids[first]);
    float x = 0;
    float y = 0;
    float count = 0;
    for (unsigned i = first; i < 4; ++i) {
      if ((left & 1u << i) == 0) continue;
      const bool same = ids[i] == ids[first] ||
                        (&finder.Find(ids[i]) == &object && SurfaceKey::AreOne(key, KeyOf(object, ids[i])));
      if (!same) continue;
      left &= ~(1u << i);
      x += kOffsetX[i];
      y += kOffsetY[i];
      count += 1;
    }
    add(ids[first], x / count, y / count, 0.25f * count);
  }
}

}  // namespace

float Shininess(float roughness) {
  const float alpha = roughness * roughness;
  return std::clamp(2.0f / std::max(alpha * alpha, 1e-4f) - 2.0f, 1.0f, 256.0f);
}

const TextureMips* FragmentShader::Surface::texture() const {
  const int index = material().texture;
  if (index < 0 || mesh().uvs.empty()) return nullptr;
  return &object->mesh->textures[static_cast<std::size_t>(index)];
}

void FragmentShader::ShadeRow(const FragmentSource& source, int v, CgLayer& layer) {
  const int row = v - layer.bounds.y;
  const auto width = static_cast<std::size_t>(layer.bounds.width);
  std::memset(layer.color.ptr(row), 0, width * sizeof(cv::Vec4f));
  std::memset(layer.depth_m.ptr(row), 0, width * sizeof(float));
  std::memset(layer.object_id.ptr(row), 0, width);
  Collect(source, v, layer);
  if (fragments_.empty()) return;
  const std::size_t count = fragments_.size();
  Reserve(count);
  FetchCorners(source.scene);
  FetchSurfaces();
  Interpolate(source.pixel_rad, count, rows_);
  ShadeLights(source.light, count, rows_);
  SampleTextures(textures_, rows_, texture_rgba_.data());
  for (std::size_t i = 0; i < surfaces_.size(); ++i) Color(i);
  Resolve(row, layer);
}

void FragmentShader::Reserve(std::size_t count) {
  if (count > rows_.capacity()) {
    rows_.Resize(count);
    const std::size_t padded = rows_.capacity() + FragmentRows::kPadding;
    texture_rgba_.resize(4 * padded);
    rgba_.resize(4 * padded);
    textures_.reserve(rows_.capacity());
    surfaces_.reserve(rows_.capacity());
  }
  textures_.resize(count);
}

void FragmentShader::Collect(const FragmentSource& source, int v, const CgLayer& layer) {
  fragments_.clear();
  const int grid_y = kSampleScale * (v - source.region_px.y);
  const int grid_x = kSampleScale * (layer.bounds.x - source.region_px.x);
  const std::int32_t* above = source.samples.triangle.ptr<std::int32_t>(grid_y) + grid_x;
  const std::int32_t* below = source.samples.triangle.ptr<std::int32_t>(grid_y + 1) + grid_x;
  const auto* rays = source.rays.ptr<cv::Vec2f>(v) + layer.bounds.x;
  ObjectFinder finder(source.scene);
  for (int column = 0; column < layer.bounds.width; ++column, above += kSampleScale, below += kSampleScale) {
    const std::int32_t ids[4] = {above[0], above[1], below[0], below[1]};
    if ((ids[0] & ids[1] & ids[2] & ids[3]) == -1) continue;  // all are -1: nothing
    const cv::Vec2f& ray = rays[column];
    if (AreOneSurface(finder, ids)) {
      fragments_.push_back({ids[0], column, ray[0], ray[1], 1.0f});
      continue;
    }
    SplitPixel(finder, ids, [&](std::int32_t id, float x, float y, float share) {
      fragments_.push_back({id, column, ray[0] + source.pixel_rad * x, ray[1] + source.pixel_rad * y, share});
    });
  }
}

void FragmentShader::FetchCorners(const CameraScene& scene) {
  using enum FragmentRows::Row;
  float* corners[6];
  for (std::size_t block = 0; block < 6; ++block) corners[block] = rows_.corner(block);
  float* ray_x = rows_.row(kRayX);
  float* ray_y = rows_.row(kRayY);
  float* share = rows_.row(kShare);
  surfaces_.clear();
  ObjectFinder finder(scene);
  const CameraObject* object = nullptr;
  std::uint32_t material = 0;
  for (std::size_t i = 0; i < fragments_.size(); ++i) {
    const Fragment& fragment = fragments_[i];
    const CameraObject& its_object = finder.Find(fragment.triangle);
    const PreparedMesh::Triangle& triangle = TriangleOf(its_object, fragment.triangle);
    if (&its_object != object || triangle.material != material) {
      object = &its_object;
      material = triangle.material;
      surfaces_.push_back({i, object, material});
    }
    const CameraVertex* vertices = scene.vertices().data() + object->first_vertex;
    for (std::size_t k = 0; k < 3; ++k) {
      const CameraVertex& vertex = vertices[triangle.corners[k]];
      Eigen::Map<Eigen::Array4f>(corners[k] + 4 * i) = vertex.position_u;
      Eigen::Map<Eigen::Array4f>(corners[k + 3] + 4 * i) = vertex.normal_v;
    }
    ray_x[i] = fragment.ray_x;
    ray_y[i] = fragment.ray_y;
    share[i] = fragment.share;
  }
}

void FragmentShader::FetchSurfaces() {
  using enum FragmentRows::Row;
  for (std::size_t s = 0; s < surfaces_.size(); ++s) {
    const Surface& surface = surfaces_[s];
    const TextureMips* texture = surface.texture();
    const auto begin = static_cast<std::ptrdiff_t>(surface.begin);
    const auto count = static_cast<std::ptrdiff_t>(EndOf(s)) - begin;
    auto fill = [&](FragmentRows::Row row, float value) {
      std::fill_n(rows_.row(row) + begin, count, value);
    };
    std::fill_n(textures_.begin() + begin, count, texture);
    fill(kTextureWidth, texture ? static_cast<float>(texture->levels()[0].width) : 0.0f);
    fill(kTextureHeight, texture ? static_cast<float>(texture->levels()[0].height) : 0.0f);
    fill(kFront, surface.object->mirrored ? -1.0f : 1.0f);
    fill(kShininess, Shininess(surface.material().roughness));
  }
}

void FragmentShader::Color(std::size_t s) {
  const Surface& surface = surfaces_[s];
  const std::size_t end = EndOf(s);
  if (const std::vector<Eigen::Vector3f>& colors = surface.mesh().colors; !colors.empty()) {
    for (std::size_t i = surface.begin; i < end; ++i) {
      const std::array<std::uint32_t, 3>& corner =
          TriangleOf(*surface.object, fragments_[i].triangle).corners;
      const float b = rows_.row(FragmentRows::kWeight1)[i];
      const float c = rows_.row(FragmentRows::kWeight2)[i];
      Eigen::Map<Eigen::Array3f>(&texture_rgba_[4 * i]) *=
          ((1 - b - c) * colors[corner[0]] + b * colors[corner[1]] + c * colors[corner[2]]).array();
    }
  }
  ColorSurface(surface.material(), surface.begin, end, rows_, texture_rgba_.data(), rgba_.data());
}

void FragmentShader::Resolve(int row, CgLayer& layer) const {
  auto* color_row = layer.color.ptr<float>(row);
  float* depth_row = layer.depth_m.ptr<float>(row);
  std::uint8_t* id_row = layer.object_id.ptr<std::uint8_t>(row);
  const float* z = rows_.row(FragmentRows::kZ);
  for (std::size_t s = 0; s < surfaces_.size(); ++s) {
    const auto id = static_cast<std::uint8_t>(std::min(surfaces_[s].object->index + 1, 255));
    const std::size_t end = EndOf(s);
    for (std::size_t i = surfaces_[s].begin; i < end; ++i) {
      const Eigen::Map<const Eigen::Array4f> rgba(&rgba_[4 * i]);
      if (!(rgba[3] > 0)) continue;
      const int column = fragments_[i].column;
      Eigen::Map<Eigen::Array4f>(color_row + 4 * column) += rgba;
      float& nearest = depth_row[column];
      if (nearest == 0 || z[i] < nearest) {
        nearest = z[i];
        id_row[column] = id;
      }
    }
  }
}

}  // namespace mixstage
