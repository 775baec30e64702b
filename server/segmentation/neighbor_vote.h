// SPDX-License-Identifier: Apache-2.0
//
// piVE 3's clean-up (7x7 and 3x3 medians against spots and holes), done on log-odds instead of on decisions:
// a few rounds of mean field for a Potts prior, whose 7x7 window is piVE's median where all evidence is
// equally strong.
#pragma once

#include <opencv2/core.hpp>

#include "server/segmentation/box_mean.h"

namespace mixstage {

class NeighborVote {
 public:
  // evidence [h x w] in: bytes as in color_evidence.h; decision [h x w] out: evidence plus neighbours, same
  // scale. strength: log-odds of a neighbourhood that agrees. Allocates on a new size only.
  void Run(const cv::Mat1b& evidence, float strength, int rounds, cv::Mat1b* decision);

 private:
  BoxMean box_{3};
  cv::Mat1b vote_, mean_;
};

}  // namespace mixstage
