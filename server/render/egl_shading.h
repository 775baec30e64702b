// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "server/gl/buffer.h"
#include "server/gl/framebuffer.h"
#include "server/gl/gpu.h"
#include "server/gl/program.h"
#include "server/gl/read_back.h"
#include "server/gl/texture.h"
#include "server/gl/vertex_array.h"
#include "server/render/cg_objects.h"
#include "server/render/cg_renderer.h"
#include "server/render/shade_lights.h"

namespace mixstage {

// The second half of a redraw on a GPU: what FragmentShader does, one fragment shader for every pixel of the
// layer (shaders/shade.frag), from the same vertices, keys, mip levels and lamps. What depends on the models
// alone is sent when the models change.
class EglShading {
 public:
  // Fails when the GPU cannot run the pass.
  static Result<EglShading> Create(std::shared_ptr<gl::Gpu> gpu, const cv::Mat2f& rays, float pixel_rad);

  // samples: triangle ids on the GPU, kSampleScale a pixel, from region's corner on. Fills the layer, which
  // covers layer.bounds. Fails (kUnavailable) when the context is lost, (kBadInput) when the scene is larger
  // than the GPU can address; the layer is then to be drawn anew.
  Status Shade(const gl::Current& current, const CameraScene& scene, const CameraIllumination& light,
               const gl::Texture& samples, const cv::Rect& region, CgLayer& layer);

 private:
  // Models as shaders/shade.frag reads them; kept for comparison, and so that a new model never has an old
  // one's address.
  using Models = std::vector<std::shared_ptr<const Mesh>>;
  // As large as the largest layer so far.
  struct Targets {
    gl::Texture color, depth_m, object_id;
    gl::Framebuffer framebuffer;
    static Result<Targets> Create(const gl::Current& current, cv::Size size);
  };
  struct Objects {
    gl::Program shade;
    gl::VertexArray vertex_array;
    gl::Texture rays;
    gl::BufferTexture vertices, triangles, keys, surfaces, colors, levels, texels, lights, ambient;
    gl::ReadBack color, depth_m, object_id;
    std::optional<Targets> targets;
    Models models;
  };

  EglShading(std::shared_ptr<gl::Gpu> gpu, const cv::Mat2f& rays, float pixel_rad);
  [[nodiscard]] Result<Objects> Make(const gl::Current& current) const;
  Status SendModels(const gl::Current& current, const CameraScene& scene, Objects& o);
  Status SendSurfaces(const gl::Current& current, const CameraScene& scene, const Objects& o);
  static Status SendLights(const gl::Current& current, const CameraIllumination& light, const Objects& o);
  static Status Read(const gl::Current& current, Objects& o, CgLayer& layer);

  std::shared_ptr<gl::Gpu> gpu_;
  cv::Mat2f rays_;
  float pixel_rad_ = 0;
  gl::PerContext<Objects> objects_;
  // Of the models that were sent, one an object of the scene.
  struct SentObject {
    std::size_t first_surface = 0;  // + material
    std::size_t first_level = 0;    // of the mesh's textures: TextureMips::kMostLevels each
    std::size_t first_color = 0;
  };
  std::vector<SentObject> sent_;
};

}  // namespace mixstage
