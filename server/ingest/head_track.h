// SPDX-License-Identifier: Apache-2.0
//
// Where the pan-tilt unit pointed at a picture's instant: encoders speak at their own rate, and their last
// digit trembles.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

#include "server/ingest/captured_frame.h"

namespace mixstage {

// One thread. All times on one clock.
class HeadTrack {
 public:
  // Readings this near to an instant speak for it, the nearer the more: at 50 Hz about three, so that a head
  // which changes its speed by 30 deg/s^2 stays within 0.01 degrees of a straight line.
  static constexpr std::int64_t kReachUs = 60'000;

  // A reading that is not later than the last one is left out.
  void Add(std::int64_t t_us, const HeadAngles& angles);
  void Clear() { readings_.clear(); }

  // A straight line through the readings around the instant, before and (in a recording) after it. The newest
  // one before it where fewer than three are near or all are long past; nothing before the first.
  [[nodiscard]] std::optional<HeadAngles> At(std::int64_t t_us) const;

 private:
  struct Reading {
    std::int64_t t_us = 0;
    HeadAngles angles;
  };
  static constexpr std::size_t kMostReadings = 64;
  std::deque<Reading> readings_;  // times rise; the newest kMostReadings
};

}  // namespace mixstage
