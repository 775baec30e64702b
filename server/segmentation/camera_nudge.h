// SPDX-License-Identifier: Apache-2.0
//
// A camera that stands still was nudged: told by how the whole picture lies against the empty set, by phase
// correlation, which people in it do not disturb. The empty set is then moved along.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "server/segmentation/background_model.h"
#include "server/segmentation/half_picture.h"

namespace mixstage {

class CameraNudge {
 public:
  static constexpr int kEvery = 15;  // pictures from one look to the next
  // A picture and what the empty set looks like. Where several looks after each other say that the picture
  // lies elsewhere: by how much, full pixels (picture = room moved by that); told once, it looks anew then.
  // One thread at a time.
  std::optional<cv::Point2d> See(const HalfPicture& picture, const BackgroundModel& room);

 private:
  int pictures_ = 0, alike_ = 0;
  cv::Point2d last_;
  cv::Mat1f now_, then_, window_;
};

// The empty set as a camera sees it that was turned so that the picture moved by `shift_px` (full pixels).
// What comes into view was never observed.
[[nodiscard]] BackgroundModel MovedAlong(const BackgroundModel& room, const cv::Point2d& shift_px);

}  // namespace mixstage
