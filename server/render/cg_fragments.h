// SPDX-License-Identifier: Apache-2.0
//
// The second half of a redraw: one row of picture pixels after another, the visibility buffer's samples
// become fragments (one a pixel and surface), fragments are shaded, and a pixel is the mean of its samples in
// linear light.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "server/render/cg_objects.h"
#include "server/render/cg_renderer.h"
#include "server/render/fragment_rows.h"
#include "server/render/shade_lights.h"

namespace mixstage {

// What the rows are made from; borrowed for the redraw.
struct FragmentSource {
  const CameraScene& scene;
  const CameraIllumination& light;
  const VisibilityBuffer& samples;  // kSampleScale a pixel
  cv::Rect region_px;               // picture pixels that samples stands for
  const cv::Mat2f& rays;            // [picture h x w] (x/z, y/z) of the pixel centres (UnprojectionTable)
  float pixel_rad = 0;              // width of a pixel as an angle, at the picture's centre
};

// Blinn-Phong's exponent for a roughness: 2 / roughness^4 - 2, kept where four samples a pixel can show it.
[[nodiscard]] float Shininess(float roughness);

class FragmentShader {
 public:
  // Writes row v (picture pixels) of the layer, which covers layer.bounds.
  void ShadeRow(const FragmentSource& source, int v, CgLayer& layer);

 private:
  struct Fragment {
    std::int32_t triangle = 0;   // of its first sample
    std::int32_t column = 0;     // in the layer
    float ray_x = 0, ray_y = 0;  // where it is shaded: the middle of its samples
    float share = 0;             // of the pixel's samples
  };
  // Fragments, one after the other, of one object and material; up to the next surface's begin.
  struct Surface {
    std::size_t begin = 0;
    const CameraObject* object = nullptr;
    std::uint32_t material_index = 0;
    [[nodiscard]] const Mesh& mesh() const { return *object->mesh->mesh; }
    [[nodiscard]] const Material& material() const { return mesh().materials[material_index]; }
    [[nodiscard]] const TextureMips* texture() const;  // nullptr: none
  };

  void Reserve(std::size_t count);
  void Collect(const FragmentSource& source, int v, const CgLayer& layer);
  // What the kernels read: corners, and what is the same all over a surface.
  void FetchCorners(const CameraScene& scene);
  void FetchSurfaces();
  void Color(std::size_t surface);
  void Resolve(int row, CgLayer& layer) const;

  [[nodiscard]] std::size_t EndOf(std::size_t surface) const {
    return surface + 1 < surfaces_.size() ? surfaces_[surface + 1].begin : fragments_.size();
  }

  std::vector<Fragment> fragments_;
  std::vector<Surface> surfaces_;
  std::vector<const TextureMips*> textures_;
  FragmentRows rows_;
  std::vector<float> texture_rgba_;
  std::vector<float> rgba_;
};

}  // namespace mixstage
