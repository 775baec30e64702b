// SPDX-License-Identifier: Apache-2.0
//
// What calibrate tells: report.json for programs, report.html (one file, no scripts) for people.
#pragma once

#include <string>

#include "server/calibration/rig_calibration.h"

namespace mixstage {

[[nodiscard]] std::string CalibrationJson(const RigCalibration& calibration, double seconds);
[[nodiscard]] std::string CalibrationPage(const RigCalibration& calibration);

}  // namespace mixstage
