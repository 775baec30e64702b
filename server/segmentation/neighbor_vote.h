// SPDX-License-Identifier: Apache-2.0
//
// piVE 3's clean-up (7x7 and 3x3 medians against spots and holes), done on log-odds instead of on decisions
// and along the picture's own edges: what looks alike is decided alike, and the outline falls onto a contrast
// that the room does not explain. Recursive filter of the domain transform (Gastal, Oliveira 2011, eq 21);
// contrasts of the room, lit or in shadow, are taken off the picture's as in "Background Cut" (Sun et al.
// 2006, eq 7).
#pragma once

#include <array>
#include <opencv2/core.hpp>

#include "server/segmentation/background_model.h"
#include "server/segmentation/box_mean.h"
#include "server/segmentation/half_picture.h"
#include "server/segmentation/tone_change.h"

namespace mixstage {

class NeighborVote {
 public:
  // evidence [Half(h) x Half(w)] in: bytes as in color_evidence.h. decision, same size, out, same scale: the
  // neighbourhood's mean and own_weight times the pixel's own evidence; no actor where nothing but single
  // pixels speaks for one. Allocates on a new size only.
  void Run(const cv::Mat1b& evidence, const HalfPicture& picture, const BackgroundModel& model,
           const ToneChange& tone, float own_weight, cv::Mat1b* decision);

 private:
  [[nodiscard]] cv::Rect BoxOfActors(const cv::Mat1b& evidence) const;
  void FindEdges(const HalfPicture& picture, const BackgroundModel& model, const ToneChange& tone);
  void FilterAlongRows(int round);
  void FilterAlongColumns(int round);

  cv::Rect box_;  // nothing outside is touched
  BoxMean box_mean_{2};
  cv::Mat1b around_;                  // [Half x Half] evidence averaged over 5x5
  std::array<cv::Mat1b, 3> room_;     // [box] the room at this frame's tone
  cv::Mat1f light_;                   // [box] brightness against the room's, 0.2..1
  cv::Mat1f keep_right_, keep_down_;  // [box] 0..1: how much of a pixel's vote its neighbour takes on
  cv::Mat1f vote_;                    // [box]
};

}  // namespace mixstage
