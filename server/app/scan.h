// SPDX-License-Identifier: Apache-2.0
//
// mixstage-server scan: a capture folder of a sweep to an environment folder.
#pragma once

#include <filesystem>
#include <string>

#include "proto/base/result.h"

namespace mixstage {

struct ScanOptions {
  std::filesystem::path views, rig, out;
  bool silent = false;  // no progress on stderr
};

// Writes the environment folder; its report.json as text. Fails with kBadInput where no scan can be made of
// the views, with kQualityGate where one was made that is no good (the folder is written, its report says
// why).
Result<std::string> RunScan(const ScanOptions& options);

}  // namespace mixstage
