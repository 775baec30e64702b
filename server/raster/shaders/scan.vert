// SPDX-License-Identifier: Apache-2.0
// raster::ProjectedVertex.
layout(location = 0) in ivec2 corner;
layout(location = 1) in float inverse_z;

noperspective out float fragment_inverse_z;

void main() {
  gl_Position = ClipOfCorner(corner, inverse_z);
  fragment_inverse_z = inverse_z;
}
