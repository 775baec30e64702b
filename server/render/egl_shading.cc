// SPDX-License-Identifier: Apache-2.0
#include "server/render/egl_shading.h"

#include <mixstage_shaders/raster.h>
#include <mixstage_shaders/render.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <span>
#include <utility>

#include "server/render/cg_fragments.h"

namespace mixstage {
namespace {

// What shade.frag's FetchSurface reads: one object's material.
struct SurfaceRecord {
  std::array<float, 3> base_color{};
  float metallic = 0;
  float shininess = 1, base_alpha = 1;
  float alpha_cutoff = -1;                                                 // < 0: no mask
  float front = 1;                                                         // -1: mirrored object
  std::int32_t first_level = -1, level_count = 0, wrap_u = 0, wrap_v = 0;  // -1: no texture
  std::int32_t color_shift = 0;  // 1 + what leads from a vertex to its colour; 0: no colours
  std::uint32_t object_id = 0;
  float head_on = 0;
  std::uint32_t unused = 0;
};
static_assert(sizeof(SurfaceRecord) == 64);
constexpr std::size_t kSurfaceTexels = 4;

// A lamp: vector and kind, normal and area, strength.
struct LightRecord {
  std::array<float, 4> vector_kind{}, normal_area{}, strength{};
};

using Words = std::array<std::uint32_t, 4>;

void CopyRows(std::span<const std::byte> from, cv::Mat& to) {
  const std::size_t row_bytes = static_cast<std::size_t>(to.cols) * to.elemSize();
  for (int y = 0; y < to.rows; ++y) {
    std::memcpy(to.ptr(y), from.data() + static_cast<std::size_t>(y) * row_bytes, row_bytes);
  }
}

}  // namespace

Result<EglShading::Targets> EglShading::Targets::Create(const gl::Current& current, cv::Size size) {
  auto color = gl::Texture::Create(current, GL_RGBA32F, size.width, size.height);
  if (!color) return tl::unexpected(color.error());
  auto depth_m = gl::Texture::Create(current, GL_R32F, size.width, size.height);
  if (!depth_m) return tl::unexpected(depth_m.error());
  auto object_id = gl::Texture::Create(current, GL_R8UI, size.width, size.height);
  if (!object_id) return tl::unexpected(object_id.error());
  auto framebuffer = gl::Framebuffer::Create(current, {&*color, &*depth_m, &*object_id}, nullptr);
  if (!framebuffer) return tl::unexpected(framebuffer.error());
  return Targets{std::move(*color), std::move(*depth_m), std::move(*object_id), std::move(*framebuffer)};
}

EglShading::EglShading(std::shared_ptr<gl::Gpu> gpu, const cv::Mat2f& rays, float pixel_rad)
    : gpu_(std::move(gpu)), rays_(rays.clone()), pixel_rad_(pixel_rad) {
  // What has no ray is not drawn; a number all the same, as GPUs disagree about those that are none.
  for (cv::Vec2f& ray : rays_) {
    if (!std::isfinite(ray[0]) || !std::isfinite(ray[1])) ray = {0, 0};
  }
}

Result<EglShading::Objects> EglShading::Make(const gl::Current& current) const {
  auto shade = gl::Program::Create(current, "shade", {shaders::whole_picture_vert}, {shaders::shade_frag});
  if (!shade) return tl::unexpected(shade.error());
  auto rays = gl::Texture::Create(current, GL_RG32F, rays_.cols, rays_.rows);
  if (!rays) return tl::unexpected(rays.error());
  rays->Write(current, GL_RG, GL_FLOAT, std::span<const cv::Vec2f>(rays_.ptr<cv::Vec2f>(0), rays_.total()));
  auto buffer = [&](GLenum format) { return gl::BufferTexture::Create(current, format); };
  Objects objects{std::move(*shade),
                  gl::VertexArray::Create(current),
                  std::move(*rays),
                  buffer(GL_RGBA32F),
                  buffer(GL_RGBA32UI),
                  buffer(GL_RGBA32UI),
                  buffer(GL_RGBA32UI),
                  buffer(GL_RGB32F),
                  buffer(GL_RGBA32UI),
                  buffer(GL_RGBA16),
                  buffer(GL_RGBA32F),
                  buffer(GL_RGBA32F),
                  {},
                  {},
                  {},
                  {},
                  {}};
  if (auto ok = current.Check("shade"); !ok) return tl::unexpected(ok.error());
  return objects;
}

Result<EglShading> EglShading::Create(std::shared_ptr<gl::Gpu> gpu, const cv::Mat2f& rays, float pixel_rad) {
  EglShading shading(std::move(gpu), rays, pixel_rad);
  auto current = shading.gpu_->Enter();
  if (!current) return Fail(ErrorCode::kUnavailable, "the GPU's context is lost");
  // One pixel of nothing: drivers finish a program at its first draw, which must not be in a show.
  auto samples = gl::Texture::Create(*current, GL_R32I, kSampleScale, kSampleScale);
  if (!samples) return tl::unexpected(samples.error());
  const std::array<std::int32_t, 4> nothing = {-1, -1, -1, -1};
  samples->Write(*current, GL_RED_INTEGER, GL_INT, std::span<const std::int32_t>(nothing));
  CgLayer layer;
  layer.bounds = {0, 0, 1, 1};
  layer.color.create(1, 1);
  layer.depth_m.create(1, 1);
  layer.object_id.create(1, 1);
  if (auto ok = shading.Shade(*current, CameraScene(nullptr), {}, *samples, layer.bounds, layer); !ok) {
    return tl::unexpected(ok.error());
  }
  return shading;
}

Status EglShading::Shade(const gl::Current& current, const CameraScene& scene,
                         const CameraIllumination& light, const gl::Texture& samples, const cv::Rect& region,
                         CgLayer& layer) {
  Objects* o = objects_.In(*gpu_, current, [&](const gl::Current& c) { return Make(c); });
  if (o == nullptr) return tl::unexpected(objects_.failure());
  const cv::Rect& bounds = layer.bounds;
  if (!o->targets || o->targets->color.width() < bounds.width || o->targets->color.height() < bounds.height) {
    cv::Size size = bounds.size();
    if (o->targets) {
      size.width = std::max(size.width, o->targets->color.width());
      size.height = std::max(size.height, o->targets->color.height());
    }
    o->targets.reset();
    auto targets = Targets::Create(current, size);
    if (!targets) return tl::unexpected(targets.error());
    o->targets = std::move(*targets);
  }
  if (auto ok = SendModels(current, scene, *o); !ok) return ok;
  if (auto ok = SendSurfaces(current, scene, *o); !ok) return ok;
  if (auto ok = SendLights(current, light, *o); !ok) return ok;
  const std::size_t vertices = scene.vertices().size();
  if (auto ok = o->vertices.Write(current, std::span<const CameraVertex>(scene.vertices()), 2 * vertices);
      !ok)
    return ok;

  const std::array<std::pair<const char*, const gl::BufferTexture*>, 9> buffers = {
      {{"vertices", &o->vertices},
       {"triangles", &o->triangles},
       {"keys", &o->keys},
       {"surfaces", &o->surfaces},
       {"colors", &o->colors},
       {"levels", &o->levels},
       {"texels", &o->texels},
       {"lights", &o->lights},
       {"ambient_terms", &o->ambient}}};
  const gl::Program& shade = o->shade;
  for (std::size_t i = 0; i < buffers.size(); ++i) {
    shade.Set(current, buffers[i].first, static_cast<int>(i) + 2);
    buffers[i].second->Bind(current, static_cast<GLuint>(i) + 2);
  }
  shade.Set(current, "samples", 0);
  samples.Bind(current, 0);
  shade.Set(current, "rays", 1);
  o->rays.Bind(current, 1);
  shade.Set(current, "first_pixel", bounds.x, bounds.y);
  shade.Set(current, "first_sample", kSampleScale * (bounds.x - region.x),
            kSampleScale * (bounds.y - region.y));
  shade.Set(current, "pixel_rad", pixel_rad_);
  shade.Set(current, "light_count", static_cast<int>(light.lights.size()));

  o->targets->framebuffer.Bind(current, bounds.width, bounds.height);
  current->Disable(GL_BLEND);
  current->Disable(GL_DEPTH_TEST);
  current->Disable(GL_CULL_FACE);
  for (GLuint output = 0; output < 3; ++output) {
    current->ColorMaski(output, GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  }
  shade.Use(current);
  o->vertex_array.Bind(current);
  current->DrawArrays(GL_TRIANGLES, 0, 3);
  return Read(current, *o, layer);
}

Status EglShading::SendModels(const gl::Current& current, const CameraScene& scene, Objects& o) {
  Models models;
  for (const CameraObject& object : scene.objects()) models.push_back(object.mesh->mesh);
  if (models == o.models && sent_.size() == models.size()) return {};
  o.models.clear();  // until all of it is there
  sent_.clear();
  std::vector<Words> triangles, keys, levels;
  std::vector<Eigen::Vector3f> colors;
  struct SentMesh {
    std::size_t first_level = 0, first_color = 0;
  };
  std::map<const PreparedMesh*, SentMesh> meshes;
  std::vector<const TextureMips*> textures;
  std::size_t texels = 0;
  std::size_t surfaces = 0;
  for (std::size_t i = 0; i < scene.objects().size(); ++i) {
    const CameraObject& object = scene.objects()[i];
    const PreparedMesh& mesh = *object.mesh;
    const auto [sent, is_new] = meshes.try_emplace(&mesh, SentMesh{levels.size(), colors.size()});
    if (is_new) {
      colors.insert(colors.end(), mesh.mesh->colors.begin(), mesh.mesh->colors.end());
      for (const TextureMips& texture : mesh.textures) {
        const TextureMips::LevelTable& table = texture.table();
        for (std::size_t level = 0; level < TextureMips::kMostLevels; ++level) {
          levels.push_back(
              {static_cast<std::uint32_t>(texels) + static_cast<std::uint32_t>(table.first[level]),
               static_cast<std::uint32_t>(table.stride[level]),
               static_cast<std::uint32_t>(table.width[level]),
               static_cast<std::uint32_t>(table.height[level])});
        }
        textures.push_back(&texture);
        texels += texture.texel_count();
      }
    }
    sent_.push_back({surfaces, sent->second.first_level, sent->second.first_color});
    const auto first_vertex = static_cast<std::uint32_t>(object.first_vertex);
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      const PreparedMesh::Triangle& triangle = mesh.triangles[t];
      triangles.push_back({triangle.corners[0] + first_vertex, triangle.corners[1] + first_vertex,
                           triangle.corners[2] + first_vertex,
                           static_cast<std::uint32_t>(surfaces) + triangle.material});
      const std::uint64_t key = mesh.surface_keys[t].lanes();
      keys.push_back({static_cast<std::uint32_t>(key), static_cast<std::uint32_t>(key >> 32),
                      static_cast<std::uint32_t>(i), 0});
    }
    surfaces += mesh.mesh->materials.size();
  }
  if (auto ok = o.triangles.Write(current, std::span<const Words>(triangles), triangles.size()); !ok)
    return ok;
  if (auto ok = o.keys.Write(current, std::span<const Words>(keys), keys.size()); !ok) return ok;
  if (auto ok = o.levels.Write(current, std::span<const Words>(levels), levels.size()); !ok) return ok;
  if (auto ok = o.colors.Write(current, std::span<const Eigen::Vector3f>(colors), colors.size()); !ok)
    return ok;
  constexpr std::size_t kTexelBytes = 4 * sizeof(std::uint16_t);
  if (auto ok = o.texels.CheckSize(current, texels); !ok) return ok;
  o.texels.buffer().Resize(current, texels * kTexelBytes);
  std::size_t first_byte = 0;
  for (const TextureMips* texture : textures) {
    const std::span<const std::uint16_t> channels(texture->texels(), 4 * texture->texel_count());
    o.texels.buffer().Fill(current, first_byte, channels);
    first_byte += channels.size_bytes();
  }
  if (auto ok = current.Check("models"); !ok) return ok;
  o.models = std::move(models);
  return {};
}

Status EglShading::SendSurfaces(const gl::Current& current, const CameraScene& scene, const Objects& o) {
  std::vector<SurfaceRecord> surfaces;
  for (std::size_t i = 0; i < scene.objects().size(); ++i) {
    const CameraObject& object = scene.objects()[i];
    const Mesh& mesh = *object.mesh->mesh;
    for (const Material& material : mesh.materials) {
      SurfaceRecord record;
      std::copy_n(material.base_color.data(), 3, record.base_color.begin());
      record.metallic = material.metallic;
      record.head_on = material.head_on;
      record.shininess = Shininess(material.roughness);
      record.base_alpha = material.base_alpha;
      if (material.alpha_mask) record.alpha_cutoff = material.alpha_cutoff;
      record.front = object.mirrored ? -1.0f : 1.0f;
      if (material.texture >= 0 && !mesh.uvs.empty()) {
        const auto texture = static_cast<std::size_t>(material.texture);
        const TextureMips& mips = object.mesh->textures[texture];
        record.first_level =
            static_cast<std::int32_t>(sent_[i].first_level + TextureMips::kMostLevels * texture);
        record.level_count = static_cast<std::int32_t>(mips.levels().size());
        record.wrap_u = static_cast<std::int32_t>(mips.wrap_u());
        record.wrap_v = static_cast<std::int32_t>(mips.wrap_v());
      }
      if (!mesh.colors.empty()) {
        // Never 0 by chance: -1 and below stand for colours that begin before the vertices.
        const auto shift =
            static_cast<std::int64_t>(sent_[i].first_color) - static_cast<std::int64_t>(object.first_vertex);
        record.color_shift = static_cast<std::int32_t>(shift >= 0 ? shift + 1 : shift);
      }
      record.object_id = static_cast<std::uint32_t>(std::min(object.index + 1, 255));
      surfaces.push_back(record);
    }
  }
  return o.surfaces.Write(current, std::span<const SurfaceRecord>(surfaces),
                          kSurfaceTexels * surfaces.size());
}

Status EglShading::SendLights(const gl::Current& current, const CameraIllumination& light, const Objects& o) {
  std::vector<LightRecord> records;
  for (const CameraLight& lamp : light.lights) {
    LightRecord record;
    std::copy_n(lamp.vector.data(), 3, record.vector_kind.begin());
    record.vector_kind[3] = static_cast<float>(lamp.kind);
    std::copy_n(lamp.normal.data(), 3, record.normal_area.begin());
    record.normal_area[3] = lamp.area;
    std::copy_n(lamp.strength.data(), 3, record.strength.begin());
    records.push_back(record);
  }
  std::array<std::array<float, 4>, AmbientLight::kTerms> ambient{};
  for (std::size_t i = 0; i < ambient.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) ambient[i][c] = light.ambient.terms[c][i];
  }
  if (auto ok = o.ambient.Write(current, std::span<const std::array<float, 4>>(ambient), ambient.size()); !ok)
    return ok;
  return o.lights.Write(current, std::span<const LightRecord>(records), 3 * records.size());
}

Status EglShading::Read(const gl::Current& current, Objects& o, CgLayer& layer) {
  const gl::Framebuffer& from = o.targets->framebuffer;
  const cv::Rect box(0, 0, layer.bounds.width, layer.bounds.height);
  if (auto ok = o.color.Start(current, from, 0, box, GL_RGBA, GL_FLOAT, sizeof(cv::Vec4f)); !ok) return ok;
  if (auto ok = o.depth_m.Start(current, from, 1, box, GL_RED, GL_FLOAT, sizeof(float)); !ok) return ok;
  if (auto ok = o.object_id.Start(current, from, 2, box, GL_RED_INTEGER, GL_UNSIGNED_BYTE, 1); !ok) return ok;
  auto color = o.color.Wait(current);
  if (!color) return tl::unexpected(color.error());
  auto depth_m = o.depth_m.Wait(current);
  if (!depth_m) return tl::unexpected(depth_m.error());
  auto object_id = o.object_id.Wait(current);
  if (!object_id) return tl::unexpected(object_id.error());
  CopyRows(*color, layer.color);
  CopyRows(*depth_m, layer.depth_m);
  CopyRows(*object_id, layer.object_id);
  return {};
}

}  // namespace mixstage
