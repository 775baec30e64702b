// SPDX-License-Identifier: Apache-2.0
//
// When a calibration is no good, and what views would help.
#pragma once

#include "server/calibration/rig_calibration.h"

namespace mixstage {

// Fills failed_gates and advice from figures and deviations.
void JudgeCalibration(RigCalibration& calibration);

}  // namespace mixstage
