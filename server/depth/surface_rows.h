// SPDX-License-Identifier: Apache-2.0
//
// Rows of SurfaceCut. The scalar code is the specification; the vector code gives the same bits. Pointers are
// to pixel 0 of a GridPicture's row: what lies a little outside may be read, and up to 7 elements right of
// width written (zeros where the input there is 0).
#pragma once

#include <cstddef>
#include <cstdint>

namespace mixstage::depth {

// Tangents of the largest angles between a surface's normal and the ray: believed from one side of a step (79
// degrees) and, where both sides agree (85 degrees), from both.
inline constexpr float kSlopeOfOneSide = 5.0f;
inline constexpr float kSlopeOfBothSides = 12.0f;

// 3x3 median of z > 0. Holes (0) stay holes; neighbours that are holes count as the pixel itself.
void MedianRow(const float* above, const float* row, const float* below, int width, float* median);
void MedianRowScalar(const float* above, const float* row, const float* below, int width, float* median);

// 255 where the edge from pixel x to pixel x + next (a column or a row on) is cut: the step exceeds the
// larger of both limits by more than the slopes before and beyond it explain. pitch: metres between
// neighbouring rays at 1 m.
void CutRow(const float* z, const float* limit, std::ptrdiff_t next, float pitch, int width,
            std::uint8_t* cut);
void CutRowScalar(const float* z, const float* limit, std::ptrdiff_t next, float pitch, int width,
                  std::uint8_t* cut);

}  // namespace mixstage::depth
