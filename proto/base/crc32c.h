// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

namespace mixstage {

// CRC-32C (Castagnoli, as iSCSI and RFC 3720 B.4 use it): reflected, start and final XOR 0xFFFFFFFF.
// "123456789" gives 0xE3069283.
// In pieces: `before` is the value over what stands before these bytes (0 = nothing).
std::uint32_t Crc32c(std::span<const std::uint8_t> bytes, std::uint32_t before = 0);

}  // namespace mixstage
