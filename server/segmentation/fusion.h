// SPDX-License-Identifier: Apache-2.0
//
// Depth's and colour's log-odds become one.
#pragma once

#include <opencv2/core.hpp>

#include "server/segmentation/color_evidence.h"

namespace mixstage {

struct FusionInput {  // all [h x w] bytes of evidence (color_evidence.h) unless said
  const cv::Mat1b& room;
  const cv::Mat1b& room_around;  // `room` averaged over 5x5
  const cv::Mat1b& shadow;
  const cv::Mat1b& depth;
  const cv::Mat1b& inside;  // 0..255: deep inside depth's actor
  float actor_prior;
  float room_weight;
};

// evidence [h x w] out. Rules: what equals the room over a neighbourhood is the room, unless depth is sure (a
// white sleeve over a white desk); what differs is actor or shadow, whichever explains it; depth adds its own
// log-odds.
void Fuse(const FusionInput& input, cv::Mat1b* evidence);
// The specification of Fuse, pixel by pixel; differs by one step at most.
void FuseScalar(const FusionInput& input, cv::Mat1b* evidence);

}  // namespace mixstage
