// SPDX-License-Identifier: Apache-2.0
#include "server/render/surface_color.h"

#include <algorithm>

namespace mixstage {

void ColorSurfaceScalar(const Material& material, std::size_t begin, std::size_t end,
                        const FragmentRows& rows, const float* texture_rgba, float* rgba) {
  using enum FragmentRows::Row;
  const float* diffuse[3] = {rows.row(kDiffuseR), rows.row(kDiffuseG), rows.row(kDiffuseB)};
  const float* specular[3] = {rows.row(kSpecularR), rows.row(kSpecularG), rows.row(kSpecularB)};
  for (std::size_t i = begin; i < end; ++i) {
    const float* texel = texture_rgba + 4 * i;
    float* out = rgba + 4 * i;
    float coverage = rows.row(kShare)[i];
    if (material.alpha_mask) {
      const float alpha = material.base_alpha * texel[3];
      coverage *= std::clamp(0.5f + kMaskSlope * (alpha - material.alpha_cutoff), 0.0f, 1.0f);
    }
    for (int c = 0; c < 3; ++c) {
      const float albedo = material.base_color[c] * texel[c];
      const float mirror = material.head_on + material.metallic * (albedo - material.head_on);
      out[c] = coverage * ((1.0f - material.metallic) * albedo * diffuse[c][i] + mirror * specular[c][i]);
    }
    out[3] = coverage;
  }
}

}  // namespace mixstage
