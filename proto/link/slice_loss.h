// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

namespace mixstage {

// The share of slices that did not arrive, over the last ten seconds. One thread.
class SliceLoss {
 public:
  // A picture is settled: so many slices of those expected came.
  void Settle(int expected, int came, std::int64_t now_us) {
    Second& second = seconds_[static_cast<std::size_t>(now_us / 1'000'000) % seconds_.size()];
    if (second.number != now_us / 1'000'000) second = {now_us / 1'000'000, 0, 0};
    second.expected += expected;
    second.came += came;
  }
  // 0 .. 1; 0 while nothing is known.
  [[nodiscard]] double Share(std::int64_t now_us) const {
    std::int64_t expected = 0, came = 0;
    for (const Second& s : seconds_) {
      if (now_us / 1'000'000 - s.number >= static_cast<std::int64_t>(seconds_.size())) continue;
      expected += s.expected;
      came += s.came;
    }
    return expected == 0 ? 0 : 1 - static_cast<double>(came) / static_cast<double>(expected);
  }

 private:
  struct Second {
    std::int64_t number = 0, expected = 0, came = 0;
  };
  std::array<Second, 10> seconds_{};
};

}  // namespace mixstage
