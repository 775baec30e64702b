// SPDX-License-Identifier: Apache-2.0
//
// A corner behind the lens: what the scan kernels read.
#pragma once

#include <cstdint>

namespace mixstage::raster {

inline constexpr int kSubPixelBits = 8;  // corners are rounded to 1/256 grid pixel
inline constexpr int kSubPixels = 1 << kSubPixelBits;
// Edges longer than this (in x or y) are split before the scan: products of sub-pixel differences then fit 32
// bits, and edge functions in whole pixels are integers below 2^24, exact in a float.
inline constexpr int kMaxEdgePx = 60;

// Where a corner lies outside; a triangle whose three corners share a bit of kOutsideMask cannot be seen.
enum Outcode : std::uint32_t {
  kLeft = 1,
  kRight = 2,
  kAbove = 4,
  kBelow = 8,
  kNear = 16,       // behind the near plane
  kNoPixel = 32,    // in front, but beyond the fold or too far outside the picture to have coordinates
  kNotFinite = 64,  // its triangles are dropped
  kCutOff = 128,    // outside the half space that is drawn
  kOutsideMask = kLeft | kRight | kAbove | kBelow | kNear | kCutOff,
  kNeedsSplit = kNear | kNoPixel | kCutOff,
};

struct ProjectedVertex {
  std::int32_t x = 0, y = 0;  // grid pixels x kSubPixels; valid without kNear, kNoPixel, kNotFinite
  float inverse_z = 0;        // 1/m
  std::uint32_t outcode = 0;
  bool operator==(const ProjectedVertex&) const = default;
};
static_assert(sizeof(ProjectedVertex) == 16, "the kernels gather 32-bit words of it");

// Where triangles are scanned into. Rows must have kRowPadding elements after the last column of the clip.
inline constexpr int kRowPadding = 8;
struct ScanTarget {
  float* inverse_z = nullptr;        // 0 = nothing
  std::int32_t* triangle = nullptr;  // nullptr: no ids are written
  std::ptrdiff_t stride = 0;         // elements, both pictures
  // Only x0 <= x <= x1, y0 <= y <= y1 is written.
  int x0 = 0, y0 = 0, x1 = -1, y1 = -1;
};

// Smallest box of pixels that may have been written (before the edges are looked at).
struct TouchedBox {
  int x0 = 1 << 30, y0 = 1 << 30, x1 = -1, y1 = -1;
};

}  // namespace mixstage::raster
