// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "proto/take/take.h"
#include "server/pipeline/studio.h"

namespace mixstage {

struct LearntRoom {
  std::shared_ptr<const BackgroundModel> model;
  RoomState state = RoomState::kKnown;
  std::string how;  // for the report: "clean plate, 10 frames"
};

// The empty set from a clean plate: every picture of the take is empty (piVE eq 1-2).
Result<LearntRoom> LearnFromCleanPlate(const Take& plate, Studio& studio, std::vector<std::string>& warnings);

// The empty set from a take that has none: its first frames where they stand still and look like the rest of
// the take, otherwise a robust estimate over pictures spread over all of it. learn_frames: L.
Result<LearntRoom> LearnFromTake(const Take& take, int learn_frames, Studio& studio,
                                 std::vector<std::string>& warnings);

}  // namespace mixstage
