// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

// The whole file. Fails (kBadInput, without the file's name: the caller puts it in front with Within) when it
// is missing, no regular file, unreadable or longer than limit_bytes.
Result<std::vector<std::uint8_t>> ReadFileBytes(const std::filesystem::path& file,
                                                std::uintmax_t limit_bytes);

}  // namespace mixstage
