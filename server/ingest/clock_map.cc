// SPDX-License-Identifier: Apache-2.0
#include "server/ingest/clock_map.h"

namespace mixstage {

void ClockMap::Observe(std::int64_t t_us, std::int64_t arrival_us) {
  // The network's word: a time so far off that the difference overflows is no time.
  std::int64_t offset_us = 0;
  if (__builtin_sub_overflow(arrival_us, t_us, &offset_us)) return;
  while (!rising_.empty() && rising_.back().offset_us >= offset_us) rising_.pop_back();
  rising_.push_back({arrival_us, offset_us});
  while (rising_.size() > 1 && arrival_us - rising_.front().arrival_us > kWindowUs) rising_.pop_front();
}

std::int64_t ClockMap::offset_us() const { return rising_.empty() ? 0 : rising_.front().offset_us; }

std::int64_t ClockMap::ToServer(std::int64_t t_us) const {
  std::int64_t server_us = 0;
  return __builtin_add_overflow(t_us, offset_us(), &server_us) ? t_us : server_us;
}

}  // namespace mixstage
