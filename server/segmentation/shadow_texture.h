// SPDX-License-Identifier: Apache-2.0
//
// A shadow scales the room's texture, an actor replaces it: the part of piVE 3's shadow label that one pixel
// cannot see.
#pragma once

#include <opencv2/core.hpp>

#include "server/segmentation/background_model.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

class ShadowTexture {
 public:
  // texture [Quarter(h) x Quarter(w)] out: log-odds >= 0 against "shadow", from the residual of the best
  // brightness factor over a window of about 12 full pixels a side, in units of the noise. Allocates on a new
  // size only.
  void Run(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
           cv::Mat1f* texture);

 private:
  cv::Mat1f now_now_, now_room_, room_room_;  // windowed means of products of luma
};

}  // namespace mixstage
