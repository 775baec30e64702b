// SPDX-License-Identifier: Apache-2.0
#include "proto/base/crc32c.h"

#include <isa-l/crc.h>

#include <algorithm>

namespace mixstage {

std::uint32_t Crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before) {
  // ISA-L takes an int length: longer inputs are fed in pieces, the running value is not inverted in between.
  constexpr std::size_t kPiece = std::size_t{1} << 30;
  std::uint32_t crc = ~before;
  while (!bytes.empty()) {
    const std::size_t n = std::min(bytes.size(), kPiece);
    // The library reads only, though its signature is not const.
    crc = crc32_iscsi(const_cast<unsigned char*>(bytes.data()), static_cast<int>(n), crc);
    bytes = bytes.subspan(n);
  }
  return ~crc;
}

}  // namespace mixstage
