// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/h264.h"

#include <array>
#include <cstdio>

namespace mixstage {

std::optional<std::string> AvcCodecString(std::span<const std::uint8_t> access_unit) {
  constexpr int kSequenceParameterSet = 7;
  // Start code 00 00 01, NAL header, then the three bytes.
  for (std::size_t i = 0; i + 7 <= access_unit.size(); ++i) {
    const std::uint8_t* nal = access_unit.data() + i;
    if (nal[0] != 0 || nal[1] != 0 || nal[2] != 1 || (nal[3] & 31) != kSequenceParameterSet) continue;
    std::array<char, 16> name{};
    std::snprintf(name.data(), name.size(), "avc1.%02X%02X%02X", nal[4], nal[5], nal[6]);
    return name.data();
  }
  return std::nullopt;
}

}  // namespace mixstage
