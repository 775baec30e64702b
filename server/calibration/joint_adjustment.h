// SPDX-License-Identifier: Apache-2.0
//
// One least-squares problem over all cameras, MixIn3D 2.1: every lens, one pose per camera relative to the
// first, one pose per board and view; a corner costs its distance in the picture over its camera's sigma
// (Cauchy beyond). algorithms: Ceres, Schur complement of the boards' poses.
#pragma once

#include "proto/base/result.h"
#include "server/calibration/adjustment_summary.h"
#include "server/calibration/board_scene.h"
#include "server/calibration/deviations.h"

namespace mixstage {

// Adjusts what is used and not held out, then fits the held-out placements' poses to the cameras found. Fails
// (kInternal) where the solver does.
Result<AdjustmentSummary> AdjustJointly(BoardScene& scene);

// The whole of it: adjusts; sets each camera's corner_sigma_px from its residuals (their median); leaves out,
// by name, sightings whose rms is beyond four times their camera's and 0.5 px; until nothing changes. Sets
// rms_px of every sighting.
Result<AdjustmentSummary> AdjustRobustly(BoardScene& scene);

// Sets rms_px of every sighting whose camera and placement have their poses.
void MeasureCorners(BoardScene& scene);

// Deviations that corners alone leave. Fails (kQualityGate, the number named) where one is not determined.
Result<Deviations> DeviationsByCorners(const BoardScene& scene);

}  // namespace mixstage
