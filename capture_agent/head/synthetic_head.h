// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <mutex>
#include <random>

#include "capture_agent/head/pan_tilt_head.h"

namespace mixstage {

// The synthetic rig's head: both axes start and stop softly and together, never faster than 60 degrees a
// second; 0.15 s after its arrival it rests. Its encoders are noisy by 0.01 degrees.
class SyntheticHead final : public PanTiltHead {
 public:
  static constexpr double kMaxSpeed_deg_s = 60, kEncoderNoise_deg = 0.01;
  static constexpr std::int64_t kSettleUs = 150'000;

  Status MoveTo(double pan_deg, double tilt_deg) override;
  Result<HeadReading> Read() override;
  [[nodiscard]] HeadLimits limits() const override { return {-160, 160, -80, 80}; }

  // The same at any instant of the monotonic clock, for the cameras that turn with it and for tests.
  Status MoveToAt(std::int64_t now_us, double pan_deg, double tilt_deg);
  // Without the encoders' noise. Instants before the last command show where it was then at rest.
  [[nodiscard]] HeadReading At(std::int64_t t_us) const;
  // When the last command's move ends at rest; a past instant where it already has.
  [[nodiscard]] std::int64_t settles_us() const;

 private:
  [[nodiscard]] HeadReading AtLocked(std::int64_t t_us) const;

  mutable std::mutex mutex_;  // guards all
  std::int64_t start_us_ = 0, end_us_ = 0;
  double from_pan_deg_ = 0, from_tilt_deg_ = 0, to_pan_deg_ = 0, to_tilt_deg_ = 0;
  std::mt19937 random_{1};
};

}  // namespace mixstage
