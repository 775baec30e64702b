// SPDX-License-Identifier: Apache-2.0
#include "proto/base/srgb.h"

#include <algorithm>
#include <cmath>

namespace mixstage {

const SrgbTables& SrgbTables::Get() {
  static const SrgbTables tables;
  return tables;
}

SrgbTables::SrgbTables() {
  for (std::size_t i = 0; i < to_linear_.size(); ++i)
    to_linear_[i] = LinearOfSrgb(static_cast<float>(i) / 255);
  for (std::size_t i = 0; i < to_srgb_.size(); ++i) {
    const float root = static_cast<float>(i) / kSteps;
    to_srgb_[i] = static_cast<std::uint8_t>(std::lround(255 * std::min(SrgbOfLinear(root * root), 1.0f)));
  }
}

}  // namespace mixstage
