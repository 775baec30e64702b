// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/head_track.h"

#include <algorithm>
#include <cmath>

namespace mixstage {

void HeadTrack::Add(std::int64_t t_us, const HeadAngles& angles) {
  if (!readings_.empty() && t_us <= readings_.back().t_us) return;
  readings_.push_back({t_us, angles});
  if (readings_.size() > kMostReadings) readings_.pop_front();
}

std::optional<HeadAngles> HeadTrack::At(std::int64_t t_us) const {
  const auto after = std::upper_bound(readings_.begin(), readings_.end(), t_us,
                                      [](std::int64_t t, const Reading& r) { return t < r.t_us; });
  if (after == readings_.begin()) return std::nullopt;
  const HeadAngles last = std::prev(after)->angles;
  // Times relative to the instant, milliseconds.
  int near = 0;
  double n = 0, sum_t = 0, sum_tt = 0;
  double sum_pan = 0, sum_tilt = 0, sum_t_pan = 0, sum_t_tilt = 0;
  for (const Reading& r : readings_) {
    const std::int64_t away_us = std::abs(r.t_us - t_us);
    if (away_us >= kReachUs) continue;
    const double weight = 1 - static_cast<double>(away_us) / static_cast<double>(kReachUs);
    const double t = static_cast<double>(r.t_us - t_us) * 1e-3;
    const double pan = r.angles.pan_deg - last.pan_deg;
    const double tilt = r.angles.tilt_deg - last.tilt_deg;
    ++near;
    n += weight;
    sum_t += weight * t;
    sum_tt += weight * t * t;
    sum_pan += weight * pan;
    sum_tilt += weight * tilt;
    sum_t_pan += weight * t * pan;
    sum_t_tilt += weight * t * tilt;
  }
  const double spread = n * sum_tt - sum_t * sum_t;
  if (near < 3 || !(spread > 0)) return last;
  return HeadAngles{last.pan_deg + (sum_tt * sum_pan - sum_t * sum_t_pan) / spread,
                    last.tilt_deg + (sum_tt * sum_tilt - sum_t * sum_t_tilt) / spread};
}

}  // namespace mixstage
