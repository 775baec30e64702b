// SPDX-License-Identifier: Apache-2.0
#include "server/raster/scan_picture.h"

#include <algorithm>
#include <cstring>

#include "proto/base/check.h"

namespace mixstage::raster {

cv::Rect RectOf(const TouchedBox& box) {
  if (box.x1 < box.x0 || box.y1 < box.y0) return {};
  return {box.x0, box.y0, box.x1 - box.x0 + 1, box.y1 - box.y0 + 1};
}

void ScanPicture::Begin(int width, int height) {
  // Vectors may have written back old values right of the box, never new ones.
  const cv::Rect touched = RectOf(touched_);
  if (!touched.empty()) {
    inverse_z_(touched).setTo(0.0f);
    depth_m_(touched).setTo(0.0f);
    if (ids_) triangle_(touched).setTo(-1);
  }
  touched_ = {};
  ids_ = false;
  width_ = width;
  height_ = height;
  if (inverse_z_.cols < width + kRowPadding || inverse_z_.rows < height) {
    const cv::Size size(std::max(inverse_z_.cols, width + kRowPadding), std::max(inverse_z_.rows, height));
    inverse_z_ = cv::Mat1f(size, 0.0f);
    depth_m_ = cv::Mat1f(size, 0.0f);
    triangle_ = cv::Mat1i(size, -1);
  }
  const cv::Rect whole(0, 0, width, height);
  buffer_ = {depth_m_(whole), triangle_(whole), {}};
}

ScanTarget ScanPicture::Target() {
  ids_ = true;
  return WholeTarget();
}

ScanTarget ScanPicture::WholeTarget() {
  MIX_CHECK(width_ > 0);  // Begin comes first
  return {inverse_z_.ptr<float>(),
          triangle_.ptr<std::int32_t>(),
          static_cast<std::ptrdiff_t>(inverse_z_.step1()),
          0,
          0,
          width_ - 1,
          height_ - 1};
}

ScanTarget ScanPicture::DepthTarget() {
  ScanTarget target = WholeTarget();
  target.triangle = nullptr;
  return target;
}

const VisibilityBuffer& ScanPicture::Finish() {
  buffer_.touched = RectOf(touched_);
  const cv::Rect& r = buffer_.touched;
  for (int y = r.y; y < r.y + r.height; ++y) {
    InverseToDepth(inverse_z_.ptr<float>(y) + r.x, depth_m_.ptr<float>(y) + r.x,
                   static_cast<std::size_t>(r.width));
  }
  return buffer_;
}

void ScanPicture::Take(const TouchedBox& box, const float* depth_m, const std::int32_t* triangle) {
  touched_ = box;
  ids_ = ids_ || triangle != nullptr;
  buffer_.touched = RectOf(touched_);
  const cv::Rect& r = buffer_.touched;
  const auto width = static_cast<std::size_t>(r.width);
  for (int y = r.y; y < r.y + r.height; ++y) {
    std::memcpy(depth_m_.ptr<float>(y) + r.x, depth_m, width * sizeof(float));
    depth_m += width;
    if (triangle == nullptr) continue;
    std::memcpy(triangle_.ptr<std::int32_t>(y) + r.x, triangle, width * sizeof(std::int32_t));
    triangle += width;
  }
}

}  // namespace mixstage::raster
