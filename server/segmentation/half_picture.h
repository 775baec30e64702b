// SPDX-License-Identifier: Apache-2.0
//
// The picture that the key looks at: RGB (sRGB, 8 bit) at half the camera's width and height. Chroma of a
// camera's JPEG has that resolution anyway, and averaging four luma samples halves the sensor's noise.
#pragma once

#include <opencv2/core.hpp>

#include "proto/codec/yuv_image.h"

namespace mixstage {

// Size of a picture after one halving; an odd last row or column is kept.
[[nodiscard]] constexpr int Half(int size) { return (size + 1) / 2; }

// Three planes [Half(h) x Half(w)], sRGB 0..255. Pixel (x, y) covers full pixels (2x..2x+1, 2y..2y+1).
struct HalfPicture {
  cv::Mat1b r;
  cv::Mat1b g;
  cv::Mat1b b;

  [[nodiscard]] int width() const { return r.cols; }
  [[nodiscard]] int height() const { return r.rows; }
};

// Averages 2x2 pixels of any chroma layout (JFIF: BT.601, full range) and converts to RGB; odd sizes repeat
// the last row or column. Rounded to 8 bit, within 2 levels of the exact equations. Allocates only where
// `half` has another size.
void HalfRgb(const YuvImage& image, HalfPicture* half);

}  // namespace mixstage
