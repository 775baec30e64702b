// SPDX-License-Identifier: Apache-2.0
#include "server/render/spread.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "proto/base/check.h"

namespace mixstage {
namespace {

// Two boxes of half width h after each other have the deviation h sqrt(2 / 3).
constexpr float kHalfWidth = 1.2247f;
constexpr float kLeast_px = 0.3f;  // less is not seen

// One line of the picture by its running sums: sums[k] is that of the pixels before k.
void Box(const std::vector<cv::Vec3f>& sums, float half_width, int at, Beyond beyond, cv::Vec3f& out) {
  const auto count = static_cast<float>(sums.size() - 1);
  const float low = static_cast<float>(at) + 0.5f - half_width;
  const float high = static_cast<float>(at) + 0.5f + half_width;
  const auto up_to = [&](float place) -> cv::Vec3f {
    const float inside = std::clamp(place, 0.0f, count);
    const auto whole = std::min(static_cast<std::size_t>(inside), sums.size() - 2);
    return sums[whole] + (inside - static_cast<float>(whole)) * (sums[whole + 1] - sums[whole]);
  };
  const float width = beyond == Beyond::kMore ? std::min(high, count) - std::max(low, 0.0f) : 2 * half_width;
  out = (up_to(high) - up_to(low)) * (1 / width);
}

}  // namespace

void Spread(SpreadAxis axis, const cv::Mat1f& sigma_px, Beyond beyond, cv::Mat3f& picture) {
  MIX_CHECK(sigma_px.size() == picture.size());
  const bool along_x = axis == SpreadAxis::kX;
  const int lines = along_x ? picture.rows : picture.cols, length = along_x ? picture.cols : picture.rows;
  std::vector<cv::Vec3f> sums(static_cast<std::size_t>(length) + 1);
  for (int line = 0; line < lines; ++line) {
    const auto at = [&](int k) -> cv::Vec3f& { return along_x ? picture(line, k) : picture(k, line); };
    const auto sigma = [&](int k) { return along_x ? sigma_px(line, k) : sigma_px(k, line); };
    for (int pass = 0; pass < 2; ++pass) {
      for (int k = 0; k < length; ++k) {
        sums[static_cast<std::size_t>(k) + 1] = sums[static_cast<std::size_t>(k)] + at(k);
      }
      for (int k = 0; k < length; ++k) {
        if (sigma(k) > kLeast_px) Box(sums, std::max(0.5f, kHalfWidth * sigma(k)), k, beyond, at(k));
      }
    }
  }
}

cv::Mat1f Continued(const cv::Mat1f& values, const cv::Mat1f& weights, int reach_px) {
  cv::Mat1f sum, weight;
  const cv::Size box(2 * reach_px + 1, 2 * reach_px + 1);
  cv::boxFilter(cv::Mat1f(values.mul(weights)), sum, CV_32F, box, {-1, -1}, false, cv::BORDER_CONSTANT);
  cv::boxFilter(weights, weight, CV_32F, box, {-1, -1}, false, cv::BORDER_CONSTANT);
  cv::Mat1f continued(values.size());
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) {
      continued(y, x) = weights(y, x) > 0      ? values(y, x)
                        : weight(y, x) > 1e-6f ? sum(y, x) / weight(y, x)
                                               : 0.0f;
    }
  }
  return continued;
}

}  // namespace mixstage
