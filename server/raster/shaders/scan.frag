// SPDX-License-Identifier: Apache-2.0
noperspective in float fragment_inverse_z;

uniform int first_id;
uniform int first_listed;  // into ids, or -1: ids count up from first_id
uniform isamplerBuffer ids;

layout(location = 0) out float depth_m;
layout(location = 1) out int triangle;

void main() {
  depth_m = 1.0 / fragment_inverse_z;
  triangle = first_listed < 0 ? first_id + gl_PrimitiveID : texelFetch(ids, first_listed + gl_PrimitiveID).r;
}
