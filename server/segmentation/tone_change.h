// SPDX-License-Identifier: Apache-2.0
//
// Auto exposure and white balance move the whole picture: I = gain * I_m + offset per channel, found anew in
// every frame on pixels that show the room. Only this follows the light; the learned picture itself never
// adapts (an adapting background absorbs a standing actor).
#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "server/segmentation/background_model.h"

namespace mixstage {

struct ToneChange {
  std::array<float, 3> gain = {1, 1, 1};    // R, G, B
  std::array<float, 3> offset = {0, 0, 0};  // grey levels

  [[nodiscard]] float luma_gain() const { return 0.299f * gain[0] + 0.587f * gain[1] + 0.114f * gain[2]; }
  [[nodiscard]] float luma_offset() const {
    return 0.299f * offset[0] + 0.587f * offset[1] + 0.114f * offset[2];
  }
};

// Robust line through (I_m, I) over a sparse grid. actor [Half(h) x Half(w)]: pixels > 0 are left out (the
// last frame's actor), empty = none. Identity where fewer than 100 usable pixels remain. Allocates nothing.
[[nodiscard]] ToneChange FindToneChange(const HalfPicture& picture, const std::array<cv::Mat1f, 3>& mean,
                                        const cv::Mat1b& actor);

}  // namespace mixstage
