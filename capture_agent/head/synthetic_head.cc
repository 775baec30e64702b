// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/head/synthetic_head.h"

#include <algorithm>
#include <cmath>

#include "proto/base/clock.h"

namespace mixstage {

Status SyntheticHead::MoveTo(double pan_deg, double tilt_deg) {
  return MoveToAt(MonotonicMicros(), pan_deg, tilt_deg);
}

Result<HeadReading> SyntheticHead::Read() {
  const std::lock_guard lock(mutex_);
  HeadReading reading = AtLocked(MonotonicMicros());
  std::normal_distribution<double> noise(0, kEncoderNoise_deg);
  reading.pan_deg += noise(random_);
  reading.tilt_deg += noise(random_);
  return reading;
}

Status SyntheticHead::MoveToAt(std::int64_t now_us, double pan_deg, double tilt_deg) {
  if (auto ok = CheckWithin(limits(), pan_deg, tilt_deg); !ok) return ok;
  const std::lock_guard lock(mutex_);
  const HeadReading here = AtLocked(now_us);
  from_pan_deg_ = here.pan_deg;
  from_tilt_deg_ = here.tilt_deg;
  to_pan_deg_ = pan_deg;
  to_tilt_deg_ = tilt_deg;
  // The soft step 3 x^2 - 2 x^3 is 1.5 times as fast in its middle as on the mean.
  const double way_deg = std::max(std::abs(pan_deg - here.pan_deg), std::abs(tilt_deg - here.tilt_deg));
  start_us_ = now_us;
  end_us_ = now_us + std::llround(1.5 * way_deg / kMaxSpeed_deg_s * 1e6);
  return {};
}

HeadReading SyntheticHead::At(std::int64_t t_us) const {
  const std::lock_guard lock(mutex_);
  return AtLocked(t_us);
}

std::int64_t SyntheticHead::settles_us() const {
  const std::lock_guard lock(mutex_);
  return end_us_ + kSettleUs;
}

HeadReading SyntheticHead::AtLocked(std::int64_t t_us) const {
  double x = 1;
  if (t_us < end_us_)
    x = std::max(0.0, static_cast<double>(t_us - start_us_) / static_cast<double>(end_us_ - start_us_));
  const double share = x * x * (3 - 2 * x);
  return {.t_us = t_us,
          .pan_deg = from_pan_deg_ + share * (to_pan_deg_ - from_pan_deg_),
          .tilt_deg = from_tilt_deg_ + share * (to_tilt_deg_ - from_tilt_deg_),
          .settled = t_us >= end_us_ + kSettleUs};
}

}  // namespace mixstage
