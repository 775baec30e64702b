// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/calibration/rig_calibration.h"

namespace mixstage {

// cv::calibrateCamera and cv::stereoCalibrate on the whole boards that took part; lenses there are OpenCV's
// own.
[[nodiscard]] std::vector<OpenCvFigures> MeasureOpenCv(const BoardScene& scene);

}  // namespace mixstage
