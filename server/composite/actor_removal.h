// SPDX-License-Identifier: Apache-2.0
//
// The camera's picture without the actor: where he or his shadow is, the room that a scan knows; everywhere
// else what the camera sees now (piVE 5: the place that the avatar has left).
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "proto/base/image_view.h"
#include "proto/codec/yuv_image.h"

namespace mixstage {

class ActorRemoval {
 public:
  // A room as it is now: gain x predicted + offset (grey levels of luma; FindToneChange).
  struct Tone {
    float gain = 1, offset = 0;
  };

  // color, room  [h x w]  the camera's picture and the room predicted for it, of one layout
  // alpha        [h x w]  coverage of the actor
  // label        [h x w]  values of Label: shadow that meets him goes with him
  // empty        out: color, with the room blended in over a soft border
  // Sizes that differ are a caller's bug (checked). One thread at a time; allocates on a new size only.
  void Run(const YuvImage& color, const YuvImage& room, ImageView<const std::uint8_t> alpha,
           ImageView<const std::uint8_t> label, const Tone& tone, YuvImage& empty);

 private:
  void KeepHis(ImageView<const std::uint8_t> alpha);

  cv::Mat1b mask_, scratch_;  // [Half(h) x Half(w)]
  cv::Mat1b small_;           // half of that
  cv::Mat1i parts_;
};

}  // namespace mixstage
