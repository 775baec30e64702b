// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/sources/source.h"

#include <algorithm>
#include <chrono>
#include <thread>

#include "proto/base/clock.h"

namespace mixstage {

bool WaitUntil(std::int64_t due_us, const std::stop_token& stop) {
  constexpr std::int64_t kSliceUs = 100'000;  // how soon a stop is noticed
  while (!stop.stop_requested()) {
    const std::int64_t left_us = due_us - MonotonicMicros();
    if (left_us <= 0) return true;
    std::this_thread::sleep_for(std::chrono::microseconds(std::min(left_us, kSliceUs)));
  }
  return false;
}

}  // namespace mixstage
