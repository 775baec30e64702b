// SPDX-License-Identifier: Apache-2.0
//
// A picture spread by another width at every pixel: what a rough surface mirrors is the less sharp the
// farther it is from the surface.
#pragma once

#include <opencv2/core.hpp>

namespace mixstage {

enum class SpreadAxis {
  kX = 1,
  kY,
};

// Each pixel becomes the mean over a triangle of deviation sigma_px(pixel) along the axis. Beyond the border
// lies what `beyond` says: kNothing (zeros), kMore (the picture's mean goes on).
enum class Beyond {
  kNothing = 1,
  kMore,
};
void Spread(SpreadAxis axis, const cv::Mat1f& sigma_px, Beyond beyond, cv::Mat3f& picture);

// Values where they have weight, the mean of those within reach_px where not; 0 where none is.
[[nodiscard]] cv::Mat1f Continued(const cv::Mat1f& values, const cv::Mat1f& weights, int reach_px);

}  // namespace mixstage
