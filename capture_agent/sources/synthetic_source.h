// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>

#include "capture_agent/head/synthetic_head.h"
#include "capture_agent/sources/source.h"
#include "proto/geometry/rig.h"
#include "proto/synthetic/scene.h"

namespace mixstage {

// The synthetic room and its walking figure (proto/synthetic) seen by a rig: colour at 30 fps, depth and
// amplitude at 12.5 fps. rig: the cameras that look; nothing = the demonstration's own. head: what they stand
// on; must outlive the source; null = they stand still. Every picture shows what the head's angles at its
// instant let see; where the head has turned a colour picture takes a second to be drawn, and those that
// would have been exposed meanwhile are skipped (a move that ends sooner is waited for). Fails where a camera
// is not valid.
Result<std::unique_ptr<Source>> MakeSyntheticSource(const std::optional<Rig>& rig,
                                                    const SyntheticConfig& config, const SyntheticHead* head,
                                                    Pace pace);

}  // namespace mixstage
