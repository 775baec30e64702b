// SPDX-License-Identifier: Apache-2.0
// Metres of what the surface holds, unless it lies behind a torn cell.
uniform sampler2D surface;  // depth buffers: T_clip_pixel's z
uniform sampler2D torn;
uniform float metres_at_1;  // z where the depth buffer holds 1

layout(location = 0) out float depth_m;

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float held = texelFetch(surface, pixel, 0).r;
  float edge = texelFetch(torn, pixel, 0).r;
  depth_m = held > 0.0 && !(edge > held) ? metres_at_1 / held : 0.0;
}
