// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/picture_light.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mixstage {

cv::Mat1f LinearLight(const cv::Mat1b& srgb) {
  static const std::array<float, 256> kLinear = [] {
    std::array<float, 256> table{};
    for (std::size_t i = 0; i < table.size(); ++i) {
      const double s = static_cast<double>(i) / 255;
      table[i] = static_cast<float>(s <= 0.04045 ? s / 12.92 : std::pow((s + 0.055) / 1.055, 2.4));
    }
    return table;
  }();
  cv::Mat1f light(srgb.size());
  std::transform(srgb.begin(), srgb.end(), light.begin(), [](std::uint8_t s) { return kLinear[s]; });
  return light;
}

cv::Mat1f CountsOfLight(const cv::Mat& counts) {
  cv::Mat1f light;
  counts.convertTo(light, CV_32F);
  return light;
}

}  // namespace mixstage
