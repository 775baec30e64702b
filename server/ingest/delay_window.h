// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <vector>

namespace mixstage {

// The median of what pictures were late beyond the fastest, over the last ten seconds. One thread.
class DelayWindow {
 public:
  static constexpr std::int64_t kWindowUs = 10'000'000;
  static constexpr std::size_t kMaxPictures = 4096;  // four streams at 100 Hz

  void Add(std::int64_t delay_us, std::int64_t now_us) {
    delays_.push_back({now_us, delay_us});
    if (delays_.size() > kMaxPictures) delays_.pop_front();
  }
  // 0 when nothing came.
  [[nodiscard]] double MedianMs(std::int64_t now_us) {
    while (!delays_.empty() && now_us - delays_.front().at_us > kWindowUs) delays_.pop_front();
    if (delays_.empty()) return 0;
    std::vector<std::int64_t> sorted;
    for (const Delay& d : delays_) sorted.push_back(d.delay_us);
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    return static_cast<double>(*middle) * 1e-3;
  }

 private:
  struct Delay {
    std::int64_t at_us = 0, delay_us = 0;
  };
  std::deque<Delay> delays_;
};

}  // namespace mixstage
