// SPDX-License-Identifier: Apache-2.0
//
// A shadow scales the room's texture, an actor replaces it: the part of piVE 3's shadow label that one pixel
// cannot see. And what goes with the room's texture shows the room, in whatever light: a reflection's colour
// is neither the room's nor a shadow's.
#pragma once

#include <opencv2/core.hpp>

#include "server/segmentation/background_model.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

class ShadowTexture {
 public:
  // texture [Quarter(h) x Quarter(w)] out: log-odds >= 0 against "shadow", from the residual of the best
  // brightness factor over a window of about 12 full pixels a side, in units of the noise.
  // kept [Quarter(h) x Quarter(w)] out: what the room's contrast explains of the picture's over about 20
  // pixels a side, beside what it leaves; 0 = nothing, or not as light would. Allocates on a new size only.
  void Run(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
           cv::Mat1f* texture, cv::Mat1f* kept);

 private:
  void Compare(const BackgroundModel& model, cv::Mat1f* kept);

  // windowed means of luma and its products where it may be shadow, and of how many there are
  cv::Mat1f count_, now_, room_, now_now_, now_room_, room_room_;
};

}  // namespace mixstage
