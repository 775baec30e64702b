// SPDX-License-Identifier: Apache-2.0
//
// Rows of a 16-bit picture to symbols (SPEC.md 3.2): what the depth codec hands to zstd. Private to the
// codec.
#pragma once

#include <cstdint>

namespace mixstage {

// A hole (0) is the symbol 0 and leaves the prediction alone: the surface beyond it goes on from the last
// measured pixel. A measured value v = 1..65535 is the symbol 1 + zigzag(v - last), differences taken modulo
// 65,535 so that every value has one symbol: 0, -1, 1, -2, ... become 1, 2, 3, 4, ...

// row [width] -> low, high [width]: the symbols' bytes, apart. `last` is what the row's first pixel is
// predicted from, 1..65535.
void EncodeRow(const std::uint16_t* row, int width, std::uint16_t last, std::uint8_t* low,
               std::uint8_t* high);
// The specification of EncodeRow.
void EncodeRowScalar(const std::uint16_t* row, int width, std::uint16_t last, std::uint8_t* low,
                     std::uint8_t* high);
// The way back.
void DecodeRow(const std::uint8_t* low, const std::uint8_t* high, int width, std::uint16_t last,
               std::uint16_t* row);

}  // namespace mixstage
