// SPDX-License-Identifier: Apache-2.0
//
// mixstage-server scan --live: drives a head over the room, records what its cameras see, and scans that.
#pragma once

#include <filesystem>
#include <string>

#include "proto/base/result.h"
#include "proto/geometry/sweep_grid.h"
#include "server/app/scan.h"

namespace mixstage {

struct LiveScanOptions {
  std::filesystem::path rig;  // as calibrate wrote it
  std::filesystem::path out;  // environment folder to write; the sweep, a new take, goes into its views/
  std::filesystem::path merge, patch;  // as of ScanOptions
  std::string lcm_url;
  SweepArea area;
  bool silent = false;  // no progress on stderr
};

// "A:B", two angles in degrees. Fails with kInvalidConfig.
Status ParseSpan(const std::string& text, double& from_deg, double& to_deg);

// Sweeps, sends the head back to where it was found, and runs the scan; says on the rig's network how it goes
// (SPEC.md 2.7). Fails with kUnavailable where no head answers, with kBadInput where too little could be
// recorded or the rig has no depth camera or pan-tilt unit, and as RunScan does.
Result<ScanOutcome> ScanLive(const LiveScanOptions& options);

}  // namespace mixstage
