// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/noise_tape.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mixstage {

NoiseTape::NoiseTape(std::uint32_t seed)
    : seed_(Mix(seed, 0x7a9eu)), normal_(kPlaces + kMaxRow), counts_(kPlaces + kMaxRow) {
  // Box and Muller, two at a time.
  for (std::size_t i = 0; i + 1 < normal_.size(); i += 2) {
    const auto k = static_cast<std::uint32_t>(i);
    const double u = (Mix(Mix(seed, k), 1) + 1.0) * 0x1p-32;
    const double v = Mix(Mix(seed, k), 2) * 0x1p-32;
    const double radius = std::sqrt(-2 * std::log(std::min(u, 1.0)));
    normal_[i] = static_cast<float>(radius * std::cos(2 * std::numbers::pi * v));
    normal_[i + 1] = static_cast<float>(radius * std::sin(2 * std::numbers::pi * v));
  }
  std::transform(normal_.begin(), normal_.end(), counts_.begin(), [](float n) {
    return static_cast<std::int8_t>(std::clamp(std::lround(n * kSigmaCounts), -127L, 127L));
  });
}

}  // namespace mixstage
