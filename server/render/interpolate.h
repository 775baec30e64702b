// SPDX-License-Identifier: Apache-2.0
//
// What lies at a fragment's ray on its triangle: position, normal, texture coordinates and how far a pixel
// reaches on the texture.
#pragma once

#include "server/render/fragment_rows.h"

namespace mixstage {

// Fills kX..kWeight2 of fragments 0..count-1. With corners p0, p1, p2, edges e1 = p1 - p0, e2 = p2 - p0 and
// the ray r = (x, y, 1), the corners' perspective-correct weights are quotients of forms linear in the ray
// (Moeller, Trumbore 1997):  b = r.(p0 x e2) / r.(e2 x e1),  c = r.(e1 x p0) / r.(e2 x e1),  a = 1 - b - c;
// so are their changes from pixel to pixel, pixel_rad apart. A ray may pass beside its triangle (it aims at
// the middle of several samples): it is then taken at the nearest edge. The scalar one is the specification.
void Interpolate(float pixel_rad, std::size_t count, FragmentRows& rows);
void InterpolateScalar(float pixel_rad, std::size_t count, FragmentRows& rows);

}  // namespace mixstage
