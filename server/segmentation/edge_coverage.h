// SPDX-License-Identifier: Apache-2.0
//
// Where between two pixels the outline runs: MixIn3D 2.4 places the depth key's boundary by comparing the
// picture with the known background. Evidence alone cannot: a pixel that is one tenth actor already differs
// from the room.
#pragma once

#include <opencv2/core.hpp>

#include "server/segmentation/background_model.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

class EdgeCoverage {
 public:
  // mask   [Half(h) x Half(w)]  > 0 actor, as decided by evidence
  // alpha  [Half(h) x Half(w)]  in/out: coverage 0..255; rewritten within 2 pixels of the mask's outline by
  //        C = a F + (1 - a) B: F from the actor beside, B the room in the light (shadow) that falls beside.
  //        Stays where F is not known or too near B. Allocates on a new size only.
  void Run(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone,
           const cv::Mat1b& mask, cv::Mat1b* alpha);

 private:
  [[nodiscard]] bool HasBand(int x, int y) const;

  cv::Mat1b inner_, outer_;
};

}  // namespace mixstage
