// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/depth_rows.h"

namespace mixstage {
namespace {

inline std::uint16_t Symbol(std::uint16_t value, std::uint16_t last) {
  int difference = int{value} - int{last};
  difference += (difference < -32767) ? 65535 : (difference > 32767) ? -65535 : 0;
  const auto zigzag = static_cast<std::uint32_t>((difference << 1) ^ (difference >> 31));
  return value == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(zigzag + 1);
}
inline std::uint16_t Value(std::uint16_t symbol, std::uint16_t last) {
  const int zigzag = symbol - 1;
  int value = int{last} + ((zigzag >> 1) ^ -(zigzag & 1));
  value += value < 1 ? 65535 : value > 65535 ? -65535 : 0;
  return symbol == 0 ? std::uint16_t{0} : static_cast<std::uint16_t>(value);
}

}  // namespace

void EncodeRowScalar(const std::uint16_t* row, int width, std::uint16_t last, std::uint8_t* low,
                     std::uint8_t* high) {
  for (int x = 0; x < width; ++x) {
    const std::uint16_t symbol = Symbol(row[x], last);
    low[x] = static_cast<std::uint8_t>(symbol);
    high[x] = static_cast<std::uint8_t>(symbol >> 8);
    last = row[x] == 0 ? last : row[x];
  }
}

void DecodeRow(const std::uint8_t* low, const std::uint8_t* high, int width, std::uint16_t last,
               std::uint16_t* row) {
  for (int x = 0; x < width; ++x) {
    row[x] = Value(static_cast<std::uint16_t>(low[x] | (high[x] << 8)), last);
    last = row[x] == 0 ? last : row[x];
  }
}

}  // namespace mixstage
