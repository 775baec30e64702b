// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/depth_rows.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace mixstage {
namespace {

// Surfaces with holes: runs of near values, runs of 0, now and then any value.
std::vector<std::uint16_t> Row(int width, unsigned seed, unsigned largest) {
  std::mt19937 random(seed);
  std::vector<std::uint16_t> row;
  std::uint16_t value = 1;
  while (row.size() < static_cast<std::size_t>(width)) {
    const bool hole = random() % 3 == 0;
    value = static_cast<std::uint16_t>(1 + random() % largest);
    for (auto n = 1 + random() % 40; n > 0 && row.size() < static_cast<std::size_t>(width); --n)
      row.push_back(
          hole ? 0
               : static_cast<std::uint16_t>(std::min(largest, value + static_cast<unsigned>(random() % 5))));
  }
  return row;
}

TEST(DepthRows, VectorAndScalarCodeAgreeAtEveryWidth) {
  for (const unsigned largest : {300u, 32767u, 65535u}) {
    for (int width = 0; width <= 67; ++width) {
      for (const int last : {1, 300, 32767, 32768, 65535}) {
        const auto start = static_cast<std::uint16_t>(last);
        const auto row = Row(width, 100u + static_cast<unsigned>(width), largest);
        std::vector<std::uint8_t> low(row.size()), high(row.size()), low2(row.size()), high2(row.size());
        EncodeRow(row.data(), width, start, low.data(), high.data());
        EncodeRowScalar(row.data(), width, start, low2.data(), high2.data());
        ASSERT_EQ(low, low2) << width;
        ASSERT_EQ(high, high2) << width;
        std::vector<std::uint16_t> back(row.size());
        DecodeRow(low.data(), high.data(), width, start, back.data());
        ASSERT_EQ(row, back) << width;
      }
    }
  }
}

}  // namespace
}  // namespace mixstage
