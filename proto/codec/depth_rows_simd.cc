// SPDX-License-Identifier: Apache-2.0
//
// Vector twin of EncodeRowScalar. Vectors without a hole, or nothing but holes, are the rule and go without a
// branch per pixel; the others, and a row's remainder, go through the scalar code.
#include <algorithm>

#include "proto/codec/depth_rows.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "proto/codec/depth_rows_simd.cc"
#include <hwy/foreach_target.h>
//
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace mixstage::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void EncodeRowImpl(const std::uint16_t* row, int width, std::uint16_t last, std::uint8_t* low,
                   std::uint8_t* high) {
  const hn::CappedTag<std::uint16_t, 16> d;
  const hn::RebindToSigned<decltype(d)> di;
  const hn::Rebind<std::uint8_t, decltype(d)> d8;
  const int lanes = static_cast<int>(hn::Lanes(d));
  const auto zero = hn::Zero(d);
  const auto low_byte = hn::Set(d, 0xFF);
  int x = 0;
  while (x < width) {
    const int count = std::min(lanes, width - x);
    const auto values = count == lanes ? hn::LoadU(d, row + x) : zero;
    // Within 1..32767 no difference leaves 16 bits, and the modulus never acts. The row's first vector has no
    // pixel before it to load.
    const bool measured = x > 0 && count == lanes && row[x - 1] != 0 && last <= 32767 &&
                          hn::AllTrue(di, hn::Gt(hn::BitCast(di, values), hn::Zero(di)));
    if (measured) {
      const auto difference = hn::BitCast(di, hn::Sub(values, hn::LoadU(d, row + x - 1)));
      const auto zigzag = hn::Xor(hn::ShiftLeft<1>(difference), hn::ShiftRight<15>(difference));
      const auto symbols = hn::Add(hn::BitCast(d, zigzag), hn::Set(d, 1));
      hn::StoreU(hn::DemoteTo(d8, hn::BitCast(di, hn::And(symbols, low_byte))), d8, low + x);
      hn::StoreU(hn::DemoteTo(d8, hn::BitCast(di, hn::ShiftRight<8>(symbols))), d8, high + x);
      last = row[x + lanes - 1];
    } else if (count == lanes && hn::AllTrue(d, hn::Eq(values, zero))) {
      hn::StoreU(hn::Zero(d8), d8, low + x);
      hn::StoreU(hn::Zero(d8), d8, high + x);
    } else {
      EncodeRowScalar(row + x, count, last, low + x, high + x);
      for (int i = x + count; i-- > x;) {
        if (row[i] == 0) continue;
        last = row[i];
        break;
      }
    }
    x += count;
  }
}

}  // namespace mixstage::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace mixstage {

HWY_EXPORT(EncodeRowImpl);

void EncodeRow(const std::uint16_t* row, int width, std::uint16_t last, std::uint8_t* low,
               std::uint8_t* high) {
  HWY_DYNAMIC_DISPATCH(EncodeRowImpl)(row, width, last, low, high);
}

}  // namespace mixstage
#endif
