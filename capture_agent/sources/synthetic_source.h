// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>

#include "capture_agent/sources/source.h"
#include "proto/geometry/rig.h"

namespace mixstage {

// The synthetic room and its walking figure (proto/synthetic) seen by a rig: colour at 30 fps, depth and
// amplitude at 12.5 fps, head angles at 10 Hz. rig: the cameras that look; nothing = the demonstration's own.
// Fails where a camera is not valid.
Result<std::unique_ptr<Source>> MakeSyntheticSource(const std::optional<Rig>& rig, Pace pace);

}  // namespace mixstage
