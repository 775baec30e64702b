// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <random>

namespace mixstage {

// The number of a program's start: not 0, and another one than that of any other start.
[[nodiscard]] inline std::int64_t RandomEpoch() {
  std::random_device random;
  return static_cast<std::int64_t>((std::uint64_t{random()} << 32 | random()) | 1);
}

}  // namespace mixstage
