// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

#include "server/raster/rasteriser.h"
#include "server/raster/scan.h"

namespace mixstage::raster {

// The visibility buffer that triangles are scanned into. Its memory grows to the largest grid and stays.
class ScanPicture {
 public:
  // Forgets what was drawn, at the cost of what that touched.
  void Begin(int width, int height);
  // Ids are written or, for depth alone, not.
  [[nodiscard]] ScanTarget Target();
  [[nodiscard]] ScanTarget DepthTarget();
  [[nodiscard]] TouchedBox& touched() { return touched_; }
  [[nodiscard]] const VisibilityBuffer& buffer() const { return buffer_; }
  // Makes the buffer of what was scanned.
  const VisibilityBuffer& Finish();
  // Fills the buffer with a picture that was drawn elsewhere: rows of both, contiguous, of the pixels inside
  // box; triangle may be null.
  void Take(const TouchedBox& box, const float* depth_m, const std::int32_t* triangle);

 private:
  ScanTarget WholeTarget();

  int width_ = 0, height_ = 0;
  // Rows padded by kRowPadding; the buffer's pictures are parts of these.
  cv::Mat1f inverse_z_, depth_m_;
  cv::Mat1i triangle_;
  TouchedBox touched_;
  bool ids_ = false;  // have been written where it is touched
  VisibilityBuffer buffer_;
};

[[nodiscard]] cv::Rect RectOf(const TouchedBox& box);

}  // namespace mixstage::raster
