// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "proto/take/take.h"
#include "server/environment/environment.h"
#include "server/pipeline/studio.h"

namespace mixstage {

// An environment folder as a show needs it: what it says and its surface, checked.
struct OpenedEnvironment {
  Environment environment;
  ScannedRoom room;
  std::vector<std::string> warnings;
  std::string how;  // for the report: "environment, 120000 triangles"
};
Result<OpenedEnvironment> OpenEnvironment(const std::filesystem::path& folder);

// The cameras of a show in it: those of `given` (--rig; null = none), else those that the scan refined; the
// pan-tilt unit is the scan's in both cases, where it had one.
Rig RigIn(const Environment& environment, const Rig* given);

// Shows the studio pictures spread over a take: the sensors' noise and, where the camera stands, the room
// itself, so that the first frame is keyed as well as the last.
void LearnPredictionFromTake(const Take& take, Studio& studio, std::vector<std::string>& warnings);

}  // namespace mixstage
