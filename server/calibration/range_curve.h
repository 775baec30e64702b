// SPDX-License-Identifier: Apache-2.0
//
// The systematic error of a ToF camera's range over distance, MixIn3D 2.1: a cubic B-spline with knots every
// half metre over the distances at which boards stood, weighted by the noise that each amplitude turns out to
// have. Where the modulation's own harmonics (the first, and the fourth of four-phase sampling: Lange 2000;
// Lindner and Kolb 2006) explain the boards as well as the spline does, they carry the curve on to other
// distances; else it is constant there.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/calibration/range_samples.h"

namespace mixstage {

struct RangeCurve {
  RangeError error;             // dense, with its deviation, for rig.json
  double from_m = 0, to_m = 0;  // the boards determine it in between
  bool harmonics = false;       // beyond: carried on by harmonics; else constant
  double noise_m = 0;           // median deviation of a sample from the curve, as a sigma
  double before_rms_m = 0,
         after_rms_m = 0;     // weighted mean error of the 0.1 m steps, without and with the curve
  double held_out_rms_m = 0;  // of view means of every 5th view, with a curve learned from the others
  double dark_minus_bright_m = 0, dark_minus_bright_std_m = 0;  // range of pixels of a tenth of the amplitude
  std::size_t samples = 0;
};

// Fails (kQualityGate) with fewer than 500 samples or distances that span less than 0.3 m.
Result<RangeCurve> FitRangeCurve(const std::vector<RangeSample>& samples,
                                 std::optional<double> unambiguous_range_m);

}  // namespace mixstage
