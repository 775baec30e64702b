// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <vector>

#include "proto/base/check.h"

namespace mixstage {

// The value in the middle, of two the larger one. Puts the values in another order; not empty (checked).
template <typename T>
[[nodiscard]] T Median(std::vector<T>& values) {
  MIX_CHECK(!values.empty());
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}
template <typename T>
[[nodiscard]] T Median(std::vector<T>&& values) {
  return Median(values);
}

}  // namespace mixstage
