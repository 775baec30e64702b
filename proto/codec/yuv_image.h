// SPDX-License-Identifier: Apache-2.0
//
// The colour picture inside MixStage: planar Y'CbCr as a JPEG holds it (JFIF: BT.601 matrix, full range, sRGB
// primaries and transfer). It stays planar from the camera's JPEG to the H.264 encoder; RGB and linear light
// appear only where something is blended or shown.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "proto/base/image_view.h"

namespace mixstage {

enum class ChromaLayout {
  k444 = 1,  // chroma [h x w]
  k422,      // chroma [h x (w+1)/2]
  k420,      // chroma [(h+1)/2 x (w+1)/2], sited at the centre of 2x2 luma pixels (JPEG's siting)
};

[[nodiscard]] constexpr int ChromaShiftX(ChromaLayout layout) { return layout == ChromaLayout::k444 ? 0 : 1; }
[[nodiscard]] constexpr int ChromaShiftY(ChromaLayout layout) { return layout == ChromaLayout::k420 ? 1 : 0; }

struct YuvImage {
  ChromaLayout layout = ChromaLayout::k420;
  cv::Mat1b y;   // [h x w], 0..255
  cv::Mat1b cb;  // chroma size of the layout, 128 = none
  cv::Mat1b cr;

  [[nodiscard]] int width() const { return y.cols; }
  [[nodiscard]] int height() const { return y.rows; }
  [[nodiscard]] bool empty() const { return y.empty(); }

  // (Re)allocates the planes; content undefined. Keeps buffers of the right size. Behind an odd width or
  // height one more column or row of luma memory follows.
  void Create(int width, int height, ChromaLayout chroma);
};

struct Rgb8 {
  std::uint8_t r = 0, g = 0, b = 0;
  bool operator==(const Rgb8&) const = default;
};

// One pixel, JFIF equations, rounded and clamped.
[[nodiscard]] Rgb8 YcbcrToRgb(std::uint8_t y, std::uint8_t cb, std::uint8_t cr);
struct Ycbcr8 {
  std::uint8_t y = 0, cb = 128, cr = 128;
};
[[nodiscard]] Ycbcr8 RgbToYcbcr(Rgb8 rgb);

// Whole pictures, for files and screens: chroma is interpolated linearly at its true siting.
[[nodiscard]] cv::Mat3b ToBgr(const YuvImage& image);
[[nodiscard]] YuvImage FromBgr(const cv::Mat3b& bgr, ChromaLayout layout);

// A part of a picture; shares its planes. `part` lies inside the picture and begins at even columns and rows
// (checked).
[[nodiscard]] YuvImage Crop(const YuvImage& image, const cv::Rect& part);

// Same picture with 4:2:0 chroma (box average). Shares the planes when it already is.
[[nodiscard]] YuvImage To420(const YuvImage& image);

}  // namespace mixstage
