// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "proto/base/result.h"
#include "server/segmentation/room_regions.h"

namespace mixstage {

// regions.yaml (SPEC.md 10). Fails (kInvalidConfig) with file, line and key on anything unknown, mistyped or
// out of range, and on a region that can hold nothing.
Result<RoomRegions> ParseRegions(const std::string& yaml_text, const std::filesystem::path& file);
Result<RoomRegions> LoadRegions(const std::filesystem::path& file);

}  // namespace mixstage
