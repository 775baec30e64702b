// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace mixstage {

// The scanned room as the colour camera would record it from a pose (MixIn3D 2.3): what the key compares
// with. Distorted view, vignetting included, at the exposure of the scan.
struct RoomPrediction {
  std::uint64_t drawing = 0;  // rises with every redraw: equal numbers, equal predictions; 0 = never drawn
  int width = 0, height = 0;  // of the full picture, px
  // [(h + 1) / 2 x (w + 1) / 2] sRGB 0..255; each covers 2x2 full pixels, as HalfPicture's.
  cv::Mat1b r, g, b;
  // Same size: kSeen the scan knows the surface; kFilled a thin gap, continued from the surface behind it; 0
  // never observed (r, g, b are 0).
  cv::Mat1b seen;
  cv::Mat1f depth_m;  // [h x w] D_M: z along the colour camera's axis, thin gaps filled; 0 = never observed

  static constexpr std::uint8_t kSeen = 255, kFilled = 128;
};

}  // namespace mixstage
