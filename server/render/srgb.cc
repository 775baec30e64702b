// SPDX-License-Identifier: Apache-2.0
#include "server/render/srgb.h"

#include <algorithm>
#include <cmath>

namespace mixstage {

const SrgbTables& SrgbTables::Get() {
  static const SrgbTables tables;
  return tables;
}

SrgbTables::SrgbTables() {
  for (int i = 0; i < 256; ++i) {
    const double v = i / 255.0;
    to_linear_[static_cast<std::size_t>(i)] =
        static_cast<float>(v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4));
  }
  for (std::size_t i = 0; i < to_srgb_.size(); ++i) {
    const double root = static_cast<double>(i) / static_cast<double>(kSteps);
    const double linear = root * root;
    const double v = linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
    to_srgb_[i] = static_cast<std::uint8_t>(std::lround(255 * std::min(v, 1.0)));
  }
}

}  // namespace mixstage
