// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

namespace mixstage {

// The RFC 6381 name ("avc1." and profile_idc, constraint flags, level_idc as hexadecimal) of an Annex B
// access unit, out of its first sequence parameter set (H.264 7.3.2.1.1). Nothing when it has none.
[[nodiscard]] std::optional<std::string> AvcCodecString(std::span<const std::uint8_t> access_unit);

}  // namespace mixstage
