// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>

namespace mixstage {

// So many events a second, with bursts.
class TokenBucket {
 public:
  TokenBucket(double per_s, double burst) : per_s_(per_s), burst_(burst), tokens_(burst) {}
  // False when the event is one too many. now_us never runs backwards.
  [[nodiscard]] bool Take(std::int64_t now_us) {
    if (last_us_ != 0)
      tokens_ = std::min(burst_, tokens_ + static_cast<double>(now_us - last_us_) * 1e-6 * per_s_);
    last_us_ = now_us;
    if (tokens_ < 1) return false;
    tokens_ -= 1;
    return true;
  }

 private:
  double per_s_, burst_, tokens_;
  std::int64_t last_us_ = 0;
};

}  // namespace mixstage
