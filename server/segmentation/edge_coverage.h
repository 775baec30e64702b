// SPDX-License-Identifier: Apache-2.0
//
// Where between two pixels the outline runs: MixIn3D 2.4 places the depth key's boundary by comparing the
// picture with the known background. Evidence alone cannot: a pixel that is one tenth actor already differs
// from the room. Known-background matting (reference: C = a F + (1 - a) B), at the picture's full size, in a
// band around what was decided at half size.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "proto/base/image_view.h"
#include "server/segmentation/background_model.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

class EdgeCoverage {
 public:
  // luma     [h x w]  of the picture
  // picture  [Half(h) x Half(w)]  its colours
  // decided  [Half(h) x Half(w)]  coverage 0..255 as evidence alone has it; scratch afterwards
  // mask     [Half(h) x Half(w)]  in: > 0 actor, as decided; out: 255 where he covers at least half, 0 else
  // alpha    [h x w]  out: coverage 0..255. Within 2 half-size pixels of the mask's outline C = a F + (1 - a)
  //          B: F from the actor beside, B the room in the light (shadow) that falls beside; as decided where
  //          F is not known or too near B. Elsewhere 0 or 255.
  // Sizes that differ are a caller's bug (checked). No allocation in steady state.
  void Run(ImageView<const std::uint8_t> luma, const HalfPicture& picture, const BackgroundModel& model,
           const ToneChange& tone, cv::Mat1b* decided, cv::Mat1b* mask, ImageView<std::uint8_t> alpha);

  // Of the last Run, [h x w] R, G, B: F, the actor's own colour without the room's share; known where 0 <
  // alpha < 255.
  [[nodiscard]] const cv::Mat3b& foreground() const { return foreground_; }

 private:
  [[nodiscard]] bool HasBand(int x, int y) const;
  void Smooth(cv::Mat1b* mask, ImageView<std::uint8_t> alpha);

  cv::Mat1b inner_, outer_;
  std::vector<cv::Point> band_;  // half-size pixels
  cv::Mat1b solved_, smooth_;    // alpha around them
  cv::Mat3b foreground_;
};

}  // namespace mixstage
