// SPDX-License-Identifier: Apache-2.0
//
// The figure's pixels, many at once (Highway, the machine's best instructions at run time). Specifications:
// depth and coverage are those of RoundCone::Intersect; lamp shares those of OccludedShare below. All
// coordinates are world axes relative to nothing (points) or per metre of camera depth (rays), float.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "proto/synthetic/figure.h"

namespace mixstage {

inline constexpr float kNoDepth = 1e9f;  // m: "nothing here" in the kernels' depth

// A body part as a camera's kernels want it.
struct PartView {
  float to_local[9];  // row-major, world axes to the part's
  float origin[3];    // to_local * (part - camera centre)
  float near_m;       // depth about which the part lies: rays start there, which keeps floats exact
  float length, radius_a, radius_b, slope;
  float albedo[3];
  float infrared;
  int u0, u1, v0, v1;  // px, inclusive: where it can be seen, with a margin; empty when u0 > u1
};

// A part as a shadow caster: the capsule inside it.
struct Caster {
  float a[3], ab[3], length2;
  float room_radius;  // for shadows on the room: the mean radius
  float body_radius;  // for shadows on the body: safely inside the part itself
};

struct SoftLamp {
  float center[3];
  float radius;  // m: disc of the lamp's area
};

inline constexpr int kLampPoints = 4;
// What lights the figure besides shadows.
struct BodyLight {
  struct Point {
    float position[3], normal[3], power[3];  // power: radiance x area / pi
  };
  Point window[kLampPoints], softbox[kLampPoints];
  SoftLamp window_lamp, softbox_lamp;
  float ambient[2][6][3];  // [low, high][+x -x +y -y +z -z][rgb] irradiance
  float ambient_z[2];      // m: heights of low and high
};

// Points and normals with room for a multiple of 16; outputs 0..1.
struct PointSpan {
  const float* p[3];
  const float* n[3];
  int count;       // a multiple of 16
  float* window;   // share of the window's light that is left
  float* softbox;  // of the soft box's
  float* ambient;  // of the light from all around
};

// One tile of kTile x kTile pixels: every plane row after row, kTile apart.
struct BodyTile {
  const float* ray[3];
  const float* vignette;
  float* z;
  float* normal[3];
  float* albedo[3];
  float* coverage;
  float* color[3];
};

// The room's layers of a tile, and the pixels made of them.
inline constexpr float kLayerScale = 16384;  // counts of a layer for the picture's white
struct ComposeTile {
  const std::uint16_t* layer[3];  // window, soft box, rest; each r, g, b planes one after another
  const float* share[3];          // 9 x 9 nodes, kShareStride apart: left of each layer; null = all
  const float* color[3];          // the figure's; null = no figure here
  const float* coverage;
  std::int16_t* y;   // out: luma x 64
  std::int16_t* cb;  // out: (chroma + 128) x 64, kTile / 2 square
  std::int16_t* cr;
  std::ptrdiff_t y_stride, chroma_stride;
};
inline constexpr int kShareStride = 16;

// z[0 .. kTile^2): the nearest part's depth at pixel centres, kNoDepth elsewhere. (u0, v0): the tile's first
// pixel.
void RasterBody(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0,
                const BodyTile& tile);
// Normals, albedo and coverage 1 where z says the body is. Neighbouring parts flow into one another.
void GatherBody(const PartView* parts, const std::uint8_t* list, int count, int u0, int v0,
                const BodyTile& tile);
// Replaces one pixel by the mean of 16 rays over its area. ray_u, ray_v: the ray's change per pixel.
void SupersampleBody(const PartView* parts, const std::uint8_t* list, int count, int u, int v, int index,
                     const float ray[3], const float ray_u[3], const float ray_v[3], const BodyTile& tile);
// color of every covered pixel.
void ShadeBody(const BodyLight& light, const Caster* casters, int caster_count, const Eigen::Vector3f& camera,
               const BodyTile& tile);
// Lamp shares at points of the room.
void OccludeRoom(const BodyLight& light, const Caster* casters, int caster_count, const PointSpan& points);
void Compose(const ComposeTile& tile);
// The sum over 8 rays of one time-of-flight pixel: where the body is nearer it replaces the room's phasor.
// rays [3][8], lengths [8], room_re/im [8]. Returns the number of rays that met the body.
int BodyPhasor(const PartView* parts, const std::uint8_t* list, int count, const float* const rays[3],
               const float* lengths, const float* room_re, const float* room_im, float radians_per_m,
               float& re, float& im);
// out = round(base / 64 + noise * (gain - luma / 8) / 1024) clamped to 0..255; luma is base where `gain`
// falls with brightness (slope 1), else not used (slope 0).
void AddNoise(const std::int16_t* base, const std::int8_t* noise, int count, int gain, int slope,
              std::uint8_t* out);

// The scalar loops that the above must agree with.
void AddNoiseScalar(const std::int16_t* base, const std::int8_t* noise, int count, int gain, int slope,
                    std::uint8_t* out);
// Share of a lamp's disc that one caster hides from a point.
float OccludedShare(const SoftLamp& lamp, const Caster& caster, float radius, float from_m, const float p[3]);
// Response of the synthetic colour camera: linear light to 0..1 of an 8-bit picture, with a soft shoulder.
float CameraResponse(float linear);

}  // namespace mixstage
