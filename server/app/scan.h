// SPDX-License-Identifier: Apache-2.0
//
// mixstage-server scan: a capture folder of a sweep to an environment folder.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "server/environment/sweep.h"

namespace mixstage {

struct ScanOptions {
  std::filesystem::path views, rig, out;
  // An earlier scan's environment folder that this one is joined with (join_rooms.h); at most one is given.
  std::filesystem::path merge{}, patch{};
  bool silent = false;                                // no progress on stderr
  std::function<void(const std::string&)> on_step{};  // hears the name of each step as it begins
};

struct ScanOutcome {
  std::string report;  // report.json
  double coverage = 0;
  int triangles = 0;
  std::vector<ViewNote> left_out;
};

// Writes the environment folder. Fails with kBadInput where no scan can be made of
// the views, with kQualityGate where one was made that is no good (the folder is written, its report says
// why).
Result<ScanOutcome> RunScan(const ScanOptions& options);

}  // namespace mixstage
