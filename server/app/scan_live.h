// SPDX-License-Identifier: Apache-2.0
//
// mixstage-server scan --live: drives a head over the room and records what its cameras see.
#pragma once

#include <filesystem>
#include <string>

#include "proto/base/result.h"
#include "proto/geometry/sweep_grid.h"

namespace mixstage {

struct LiveScanOptions {
  std::filesystem::path rig;    // as calibrate wrote it
  std::filesystem::path views;  // capture folder to write: a new take
  std::string lcm_url;
  SweepArea area;
  bool silent = false;  // no progress on stderr
};

// "A:B", two angles in degrees. Fails with kInvalidConfig.
Status ParseSpan(const std::string& text, double& from_deg, double& to_deg);

// Returns when all positions of the sweep are recorded or left out, and the head is on its way back to where
// it was found. Fails with kUnavailable where no head answers, with kBadInput where too little could be
// recorded or the rig has no depth camera or pan-tilt unit.
Status RecordSweep(const LiveScanOptions& options);

}  // namespace mixstage
