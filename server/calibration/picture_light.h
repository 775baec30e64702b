// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

namespace mixstage {

// Brightness proportional to light: 8-bit pictures of ordinary cameras through the sRGB curve, counts of a
// ToF camera as they are.
[[nodiscard]] cv::Mat1f LinearLight(const cv::Mat1b& srgb);
[[nodiscard]] cv::Mat1f CountsOfLight(const cv::Mat& counts);

}  // namespace mixstage
