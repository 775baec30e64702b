// SPDX-License-Identifier: Apache-2.0
//
// room.glb of an environment folder (SPEC.md 9): the scanned room as a textured surface.
#pragma once

#include <filesystem>

#include "proto/base/result.h"
#include "server/environment/environment_folder.h"

namespace mixstage {

// glTF 2.0 binary, one mesh, its texture a JPEG inside. `room` is valid (checked). Fails with kUnavailable
// (disk).
Status WriteRoom(const std::filesystem::path& folder, const RoomModel& room);

// Read as any model of a stranger is, in a process of its own. Corners that are alike are joined. Fails
// (kBadInput) where it is missing, broken, without texture or with more than one.
Result<RoomModel> ReadRoom(const std::filesystem::path& folder);

}  // namespace mixstage
