// SPDX-License-Identifier: Apache-2.0
//
// A scene back into scene.yaml (SPEC.md 7).
#pragma once

#include <filesystem>
#include <string>

#include "proto/base/result.h"
#include "server/scene/scene.h"

namespace mixstage {

// The text: what ParseScene reads out of it is the scene, number by number. An object that was placed by
// position and rotation stays so written; others have their pose.
[[nodiscard]] std::string ToYaml(const Scene& scene);

// Writes the file at once or not at all (a new file, synced, renamed over it); the file before, with its
// author's comments, becomes FILE.bak. What would not be read back is not written. Fails with kUnavailable
// (folder, disk, rights) or kInternal, the file named.
Status WriteScene(const Scene& scene, const std::filesystem::path& file);

}  // namespace mixstage
