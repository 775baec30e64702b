// SPDX-License-Identifier: Apache-2.0
//
// Which colours the actors wear, learnt from frames already keyed: a histogram in place of "any colour
// alike". piVE 3 asks only how unlike the room a colour is; what also resembles nothing he wears is rather a
// shadow, and hair before a dark shelf is still hair.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "server/segmentation/half_picture.h"

namespace mixstage {

class ActorColors {
 public:
  // A keyed frame. core [Half(h) x Half(w)] > 0: deep inside an actor; evidence: what the pixels said there.
  // Older frames fade within about ten in which there is an actor.
  void Learn(const HalfPicture& picture, const cv::Mat1b& core, const cv::Mat1b& evidence);
  // likelihood [Half(h) x Half(w)] out: bytes as in color_evidence.h, ln of the colour's density among the
  // actors' over that of any colour. Nothing (128) before anything was learnt. Allocates on a new size only.
  void Rate(const HalfPicture& picture, cv::Mat1b* likelihood) const;

 private:
  void Summarise();

  double weight_ = 0;          // pixels in counts_
  std::vector<float> counts_;  // [bins^3], red slowest
  std::vector<float> smooth_, scratch_;
  std::vector<std::uint8_t> likelihood_;  // [bins^3]
};

}  // namespace mixstage
