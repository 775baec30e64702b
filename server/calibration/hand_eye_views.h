// SPDX-License-Identifier: Apache-2.0
//
// Which of a calibration's views tell how the cameras sit on the head, and what is told of it in a report.
#pragma once

#include <optional>
#include <string>

#include "server/calibration/rig_calibration.h"

namespace mixstage {

// Views with the head's angles, of folders in which the head turns by more than 1 degree (boards stand still
// there; where the head stands still boards are carried about). Boards of different folders are different
// ones. Cameras are the calibrated rig's. Nothing without such views or without a calibrated colour camera.
[[nodiscard]] std::optional<HandEyeInput> HandEyeViews(const RigCalibration& calibration);

}  // namespace mixstage
