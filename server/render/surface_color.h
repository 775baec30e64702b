// SPDX-License-Identifier: Apache-2.0
//
// The colour of fragments: what a material makes of its texture and of the light that arrives.
#pragma once

#include <cstddef>

#include "server/render/fragment_rows.h"
#include "server/scene/mesh.h"

namespace mixstage {

// Fragments begin..end-1, all of one material: R G B in linear light, times coverage, and the coverage (four
// floats each), from kShare, kDiffuseR..kSpecularB and the texture's colours. Both arrays have room for
// FragmentRows::kPadding fragments after the last; what is after end in rgba is lost. The scalar one is the
// specification.
void ColorSurface(const Material& material, std::size_t begin, std::size_t end, const FragmentRows& rows,
                  const float* texture_rgba, float* rgba);
void ColorSurfaceScalar(const Material& material, std::size_t begin, std::size_t end,
                        const FragmentRows& rows, const float* texture_rgba, float* rgba);

inline constexpr float kMaskSlope = 4.0f;  // the cut-off is a ramp of alpha, so that its edge is soft

}  // namespace mixstage
