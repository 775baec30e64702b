// SPDX-License-Identifier: Apache-2.0
#include "server/segmentation/nearest_depth.h"

#include <cstddef>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "proto/base/check.h"

namespace mixstage {

bool FindNearestDepth(const cv::Mat1f& depth_m, cv::Mat1f* nearest_m, cv::Mat1f* distance_px) {
  MIX_CHECK(nearest_m != nullptr && distance_px != nullptr);
  cv::Mat1b unknown;
  cv::compare(depth_m, 0, unknown, cv::CMP_LE);
  if (cv::countNonZero(unknown) == static_cast<int>(unknown.total())) return false;
  cv::Mat1i label;
  cv::distanceTransform(unknown, *distance_px, label, cv::DIST_L2, cv::DIST_MASK_5, cv::DIST_LABEL_PIXEL);
  std::vector<float> depth_of(unknown.total() + 1, 0.0f);  // by label
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x) {
      if (unknown(y, x) == 0) depth_of[static_cast<std::size_t>(label(y, x))] = depth_m(y, x);
    }
  }
  nearest_m->create(depth_m.size());
  for (int y = 0; y < depth_m.rows; ++y) {
    for (int x = 0; x < depth_m.cols; ++x)
      (*nearest_m)(y, x) = depth_of[static_cast<std::size_t>(label(y, x))];
  }
  return true;
}

}  // namespace mixstage
