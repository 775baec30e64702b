// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "proto/synthetic/texture.h"

namespace mixstage {

// Sensor noise that costs nothing per frame: a tape of Gaussian numbers, read from another place for every
// row of every frame. The same (seed, frame, row) reads the same numbers.
class NoiseTape {
 public:
  static constexpr int kMaxRow = 8192;     // numbers that can be read from any place
  static constexpr int kSigmaCounts = 24;  // standard deviation of Counts()

  explicit NoiseTape(std::uint32_t seed);

  [[nodiscard]] const std::int8_t* Counts(std::uint32_t frame, std::uint32_t row) const {
    return counts_.data() + Start(frame, row);
  }
  [[nodiscard]] const float* Normal(std::uint32_t frame, std::uint32_t row) const {  // standard deviation 1
    return normal_.data() + Start(frame, row);
  }

 private:
  static constexpr std::uint32_t kPlaces = 1u << 17;
  [[nodiscard]] std::uint32_t Start(std::uint32_t frame, std::uint32_t row) const {
    return Mix(Mix(seed_, frame), row) % kPlaces;
  }
  std::uint32_t seed_;
  std::vector<float> normal_;
  std::vector<std::int8_t> counts_;
};

}  // namespace mixstage
