// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "proto/base/result.h"

namespace mixstage {

// Encoder angles, degrees: positive pan turns left, positive tilt turns up.
struct HeadLimits {
  double pan_min_deg = -180, pan_max_deg = 180, tilt_min_deg = -90, tilt_max_deg = 90;
};

struct HeadReading {
  std::int64_t t_us = 0;  // this machine's monotonic clock
  double pan_deg = 0, tilt_deg = 0;
  bool settled = false;  // it rests where it was sent
};

// A pan-tilt unit: real or synthetic (one file each). Any thread.
class PanTiltHead {
 public:
  virtual ~PanTiltHead() = default;
  // Goes there, from wherever it is; a later call changes the goal. Returns at once. Fails (kBadInput, the
  // limit named) beyond the limits, with NaN too, and leaves the head as it is.
  virtual Status MoveTo(double pan_deg, double tilt_deg) = 0;
  // Where it is now, as its encoders say. Fails with kUnavailable where the unit does not answer.
  virtual Result<HeadReading> Read() = 0;
  [[nodiscard]] virtual HeadLimits limits() const = 0;
};

// What every MoveTo checks first.
Status CheckWithin(const HeadLimits& limits, double pan_deg, double tilt_deg);

}  // namespace mixstage
