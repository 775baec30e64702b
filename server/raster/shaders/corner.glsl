// SPDX-License-Identifier: Apache-2.0
// Corners come through the lens on the CPU, in its code: both back ends see the same 1/256 px.
uniform mat4 T_clip_pixel;

vec4 ClipOfCorner(ivec2 sub_pixels, float inverse_z) {
  return T_clip_pixel * vec4(vec2(sub_pixels) * (1.0 / 256.0), inverse_z, 1.0);
}
