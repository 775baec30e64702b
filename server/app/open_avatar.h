// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "server/pipeline/studio.h"
#include "server/scene/scene.h"

namespace mixstage {

struct OpenedAvatar {
  AvatarSetup setup;
  std::vector<std::string> warnings;
};
// What the scene's avatar names, relative to the scene's file: an environment folder, or a capture folder
// with depth. A scene without an avatar, or with one in the show's own room, opens nothing.
Result<OpenedAvatar> OpenAvatar(const Scene& scene, const std::filesystem::path& scene_file);

}  // namespace mixstage
