// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>

namespace mixstage {

// What one source (epoch) may send: two token buckets, each of a second's worth. A slice costs work, the
// first slice of a picture makes the receiver take memory for the whole of it. One thread.
class SourceQuota {
 public:
  // Four streams of 200 kB at 30 Hz are 20,000 slices and 25 MB a second with a little parity; an agent that
  // sends a take as fast as its pauses allow (publisher.h) stays below 32,000.
  static constexpr std::int64_t kSlicesPerSecond = 40'000;
  static constexpr std::int64_t kPictureBytesPerSecond = std::int64_t{64} << 20;

  // False when it is one too many. now_us never runs backwards.
  [[nodiscard]] bool TakeSlice(std::int64_t now_us) { return slices_.Take(1, kSlicesPerSecond, now_us); }
  [[nodiscard]] bool TakePicture(std::size_t bytes, std::int64_t now_us) {
    return bytes_.Take(static_cast<double>(bytes), kPictureBytesPerSecond, now_us);
  }

 private:
  struct Bucket {
    double spent = 0;  // of a second's worth; flows back with time
    std::int64_t last_us = 0;
    bool Take(double amount, double per_second, std::int64_t now_us) {
      spent = std::max(0.0, spent - static_cast<double>(now_us - last_us) * 1e-6 * per_second);
      last_us = now_us;
      if (spent + amount > per_second) return false;
      spent += amount;
      return true;
    }
  };
  Bucket slices_, bytes_;
};

}  // namespace mixstage
