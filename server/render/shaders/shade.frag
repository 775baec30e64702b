// SPDX-License-Identifier: Apache-2.0
// One pixel of the CG layer: its four samples become fragments (one a surface), each is shaded, and the pixel
// is their sum by share, in linear light. The scalar C++ is the specification; functions are named as there.
uniform isampler2D samples;  // triangle ids, 2 x 2 a pixel; -1 = nothing
uniform sampler2D rays;      // (x/z, y/z) of the picture's pixel centres
uniform ivec2 first_pixel;   // of the layer, in the picture
uniform ivec2 first_sample;  // of the layer, in samples
uniform float pixel_rad;

uniform samplerBuffer vertices;    // CameraVertex: (x, y, z, u), (normal, v)
uniform usamplerBuffer triangles;  // three corners, surface
uniform usamplerBuffer keys;       // SurfaceKey's two words, object
uniform usamplerBuffer surfaces;   // kSurfaceTexels a surface: EglShading::SurfaceRecord
uniform samplerBuffer colors;      // of vertices
uniform usamplerBuffer levels;     // first texel, stride, width, height
uniform samplerBuffer texels;      // all textures' levels with their borders, linear light
uniform samplerBuffer lights;      // EglShading::LightRecord: three a lamp
uniform int light_count;
uniform samplerBuffer ambient_terms;  // AmbientLight's: a texel a term

layout(location = 0) out vec4 layer_color;
layout(location = 1) out float layer_depth_m;
layout(location = 2) out uint layer_object_id;

const int kSurfaceTexels = 4;
const float kMostTaps = 4.0;
const float kBeside = -0.1;
const float kLongestStep = 16.0;
const float kMaskSlope = 4.0;
const float kPi = 3.14159265358979;

struct Surface {
  vec3 base_color;
  float metallic, shininess, base_alpha, alpha_cutoff, front;
  int first_level, level_count, wrap_u, wrap_v;
  int color_shift;
  uint object_id;
  float head_on;
};

Surface FetchSurface(int index) {
  uvec4 a = texelFetch(surfaces, kSurfaceTexels * index);
  uvec4 b = texelFetch(surfaces, kSurfaceTexels * index + 1);
  uvec4 c = texelFetch(surfaces, kSurfaceTexels * index + 2);
  uvec4 d = texelFetch(surfaces, kSurfaceTexels * index + 3);
  vec4 e = uintBitsToFloat(a);
  vec4 f = uintBitsToFloat(b);
  ivec4 g = ivec4(c);
  return Surface(e.rgb, e.a, f.x, f.y, f.z, f.w, g.x, g.y, g.z, g.w, int(d.x), d.y,
                 uintBitsToFloat(d.z));
}

// SurfaceKey::AreOne, of one object.
bool AreOne(uvec4 a, uvec4 b) {
  if (a.z != b.z || (a.y >> 16) != (b.y >> 16)) return false;
  ivec3 of_a = ivec3(a.y & 0xffffu, a.x >> 16, a.x & 0xffffu);
  ivec3 of_b = ivec3(b.y & 0xffffu, b.x >> 16, b.x & 0xffffu);
  return all(lessThanEqual(abs(of_a - of_b), ivec3(1024)));
}

float WrapCoordinate(float t, int wrap) {
  if (wrap == 1) return t - floor(t);
  if (wrap == 2) return clamp(t, 0.0, 1.0);
  float pair = t - 2.0 * floor(0.5 * t);
  return pair > 1.0 ? 2.0 - pair : pair;
}

vec4 Bilinear(uvec4 level, float s, float t) {
  float x = s * float(level.z) + 0.5;  // counted from the border: never negative
  float y = t * float(level.w) + 0.5;
  int column = int(x);
  int row = int(y);
  int upper = int(level.x) + row * int(level.y) + column;
  int lower = upper + int(level.y);
  float across = x - float(column);
  vec4 top = mix(texelFetch(texels, upper), texelFetch(texels, upper + 1), across);
  vec4 bottom = mix(texelFetch(texels, lower), texelFetch(texels, lower + 1), across);
  return mix(top, bottom, y - float(row));
}

vec4 Sample(Surface surface, vec2 uv, float texels_a_tap) {
  float s = WrapCoordinate(uv.x, surface.wrap_u);
  float t = WrapCoordinate(uv.y, surface.wrap_v);
  int fine = 0;
  float share_of_coarse = 0.0;
  if (texels_a_tap > 1.0) {  // LevelsFor
    float level = float(floatBitsToInt(texels_a_tap)) * (1.0 / 8388608.0) - 127.0;
    if (level >= float(surface.level_count - 1)) {
      fine = surface.level_count - 1;
    } else {
      fine = int(level);
      share_of_coarse = 2.0 * (level - float(fine)) - 0.5;
      if (share_of_coarse >= 1.0) {
        fine += 1;
        share_of_coarse = 0.0;
      }
      share_of_coarse = max(share_of_coarse, 0.0);
    }
  }
  vec4 color = Bilinear(texelFetch(levels, surface.first_level + fine), s, t);
  if (share_of_coarse > 0.0) {
    vec4 coarse = Bilinear(texelFetch(levels, surface.first_level + fine + 1), s, t);
    color += share_of_coarse * (coarse - color);
  }
  return color;
}

vec3 AmbientTerm(int i) { return texelFetch(ambient_terms, i).rgb; }

float SaneStep(float along) { return abs(along) <= kLongestStep ? along : 0.0; }

void Shade(int id, vec2 ray_xy, float share, out vec4 rgba, out float z, out uint object_id) {
  uvec4 triangle = texelFetch(triangles, id);
  Surface surface = FetchSurface(int(triangle.w));
  object_id = surface.object_id;
  ivec3 corner = ivec3(triangle.xyz);
  vec4 p0u = texelFetch(vertices, 2 * corner.x);
  vec4 p1u = texelFetch(vertices, 2 * corner.y);
  vec4 p2u = texelFetch(vertices, 2 * corner.z);
  vec4 n0 = texelFetch(vertices, 2 * corner.x + 1);
  vec4 n1 = texelFetch(vertices, 2 * corner.y + 1) - n0;
  vec4 n2 = texelFetch(vertices, 2 * corner.z + 1) - n0;

  // Interpolate.
  vec3 e1 = p1u.xyz - p0u.xyz;
  vec3 e2 = p2u.xyz - p0u.xyz;
  vec3 B = cross(p0u.xyz, e2);
  vec3 C = cross(e1, p0u.xyz);
  vec3 D = cross(e2, e1);
  vec3 ray = vec3(ray_xy, 1.0);
  float denominator = dot(ray, D);
  float inverse = abs(denominator) > 1e-20 ? 1.0 / denominator : 0.0;
  float exact_b = dot(ray, B) * inverse;
  float exact_c = dot(ray, C) * inverse;
  vec3 inside = max(vec3(kBeside), vec3(1.0 - exact_b - exact_c, exact_b, exact_c));
  float sum = 1.0 / max(inside.x + inside.y + inside.z, 1e-20);
  float b = inside.y * sum;
  float c = inside.z * sum;
  vec3 p = p0u.xyz + b * e1 + c * e2;
  z = p.z;
  float side = denominator * surface.front < 0.0 ? -1.0 : 1.0;
  vec4 normal_v = n0 + b * n1 + c * n2;
  vec3 n = normalize(side * normal_v.xyz);

  vec4 texture_rgba = vec4(1.0);
  if (surface.first_level >= 0) {
    float u1 = p1u.w - p0u.w;
    float u2 = p2u.w - p0u.w;
    vec2 uv = vec2(p0u.w + b * u1 + c * u2, normal_v.w);
    float change = pixel_rad * inverse;
    vec2 db = change * (B - exact_b * D).xy;
    vec2 dc = change * (C - exact_c * D).xy;
    vec2 du = db * u1 + dc * u2;  // per pixel to the right, down
    vec2 dv = db * n1.w + dc * n2.w;
    vec2 size = vec2(texelFetch(levels, surface.first_level).zw);
    vec2 right = vec2(du.x, dv.x) * size;
    vec2 down = vec2(du.y, dv.y) * size;
    bool right_is_longer = dot(right, right) >= dot(down, down);
    vec2 along = right_is_longer ? vec2(SaneStep(du.x), SaneStep(dv.x)) : vec2(SaneStep(du.y), SaneStep(dv.y));
    // Footprint.
    float longer = sqrt(max(dot(right, right), dot(down, down)));
    float area = abs(right.x * down.y - right.y * down.x);
    float shorter = area / max(longer, 1e-12);
    float wanted = ceil(0.5 * longer / max(shorter, 1e-12) - 0.01);
    float taps = min(longer > 1.0 ? kMostTaps : 1.0, max(1.0, wanted));
    float texels_a_tap = max(sqrt(area / taps), 0.5 * longer / taps);
    texture_rgba = vec4(0.0);
    for (float k = 0.0; k < taps; k += 1.0) {
      texture_rgba += Sample(surface, uv + ((k + 0.5) / taps - 0.5) * along, texels_a_tap);
    }
    texture_rgba /= taps;
  }
  if (surface.color_shift != 0) {
    ivec3 at = corner + (surface.color_shift > 0 ? surface.color_shift - 1 : surface.color_shift);
    texture_rgba.rgb *= (1.0 - b - c) * texelFetch(colors, at.x).rgb + b * texelFetch(colors, at.y).rgb +
                        c * texelFetch(colors, at.z).rgb;
  }

  // ShadeLights.
  vec3 view = -normalize(p);
  vec3 of_x = AmbientTerm(1) + n.x * AmbientTerm(4) + n.y * AmbientTerm(7) + n.z * AmbientTerm(8);
  vec3 of_y = AmbientTerm(2) + n.y * AmbientTerm(5) + n.z * AmbientTerm(9);
  vec3 of_z = AmbientTerm(3) + n.z * AmbientTerm(6);
  vec3 ambient = max(vec3(0.0), AmbientTerm(0) + n.x * of_x + n.y * of_y + n.z * of_z);
  vec3 diffuse = ambient;
  vec3 specular = ambient;
  for (int i = 0; i < light_count; ++i) {
    vec4 vector_kind = texelFetch(lights, 3 * i);
    vec4 normal_area = texelFetch(lights, 3 * i + 1);
    vec3 strength = texelFetch(lights, 3 * i + 2).rgb;
    vec3 toward = vector_kind.xyz;
    float incident = 1.0;
    if (vector_kind.w != 1.0) {
      vec3 to_light = vector_kind.xyz - p;
      float d2 = max(dot(to_light, to_light), 1e-6);
      toward = to_light / sqrt(d2);
      incident = vector_kind.w == 2.0
                     ? 1.0 / d2
                     : max(0.0, -dot(normal_area.xyz, toward)) / (kPi * d2 + normal_area.w);
    }
    float received = incident * max(0.0, dot(n, toward));
    diffuse += received * strength;
    float cosine = max(0.0, dot(n, normalize(toward + view)));
    float lobe = cosine / (surface.shininess - surface.shininess * cosine + cosine);
    specular += received * 0.125 * (surface.shininess + 8.0) * lobe * strength;
  }

  // ColorSurface.
  float coverage = share;
  if (surface.alpha_cutoff >= 0.0) {
    float alpha = surface.base_alpha * texture_rgba.a;
    coverage *= clamp(0.5 + kMaskSlope * (alpha - surface.alpha_cutoff), 0.0, 1.0);
  }
  vec3 albedo = surface.base_color * texture_rgba.rgb;
  vec3 mirror = surface.head_on + surface.metallic * (albedo - surface.head_on);
  rgba = vec4(coverage * ((1.0 - surface.metallic) * albedo * diffuse + mirror * specular), coverage);
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  ivec2 at = first_sample + 2 * pixel;
  int ids[4] = int[4](texelFetch(samples, at, 0).r, texelFetch(samples, at + ivec2(1, 0), 0).r,
                      texelFetch(samples, at + ivec2(0, 1), 0).r, texelFetch(samples, at + ivec2(1, 1), 0).r);
  layer_color = vec4(0.0);
  layer_depth_m = 0.0;
  layer_object_id = 0u;
  vec2 center = texelFetch(rays, first_pixel + pixel, 0).rg;
  uvec4 sample_keys[4];
  for (int i = 0; i < 4; ++i) {
    if (ids[i] >= 0) sample_keys[i] = texelFetch(keys, ids[i]);
  }
  // Samples of one surface become one fragment, shaded in their middle.
  for (int first = 0; first < 4; ++first) {
    if (ids[first] < 0) continue;
    vec2 middle = vec2(0.0);
    float count = 0.0;
    int id = ids[first];
    for (int i = first; i < 4; ++i) {
      if (ids[i] < 0 || !(ids[i] == id || AreOne(sample_keys[first], sample_keys[i]))) continue;
      middle += vec2((i & 1) != 0 ? 0.25 : -0.25, i >= 2 ? 0.25 : -0.25);
      count += 1.0;
      ids[i] = -1;
    }
    vec4 rgba;
    float z;
    uint object_id;
    Shade(id, center + pixel_rad * (middle / count), 0.25 * count, rgba, z, object_id);
    if (!(rgba.a > 0.0)) continue;
    layer_color += rgba;
    if (layer_depth_m == 0.0 || z < layer_depth_m) {
      layer_depth_m = z;
      layer_object_id = object_id;
    }
  }
}
