// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>

namespace mixstage {

// Maps the times of one agent's epoch to the server's clock by the lower envelope of (arrival - t_us): the
// fastest message of the window is taken to have travelled in no time (SPEC.md 1, "Clocks"). The window
// slides, so that the drift of the agent's clock against ours is followed. A new epoch needs a new ClockMap.
// One thread.
class ClockMap {
 public:
  static constexpr std::int64_t kWindowUs = 10'000'000;

  void Observe(std::int64_t t_us, std::int64_t arrival_us);
  // Server time of an agent's time; before the first Observe the time itself.
  [[nodiscard]] std::int64_t ToServer(std::int64_t t_us) const;
  [[nodiscard]] std::int64_t offset_us() const;

 private:
  struct Observation {
    std::int64_t arrival_us = 0, offset_us = 0;
  };
  std::deque<Observation> rising_;  // offsets rise from front to back: the front is the minimum of the window
};

}  // namespace mixstage
