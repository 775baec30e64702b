// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

struct CalibrateOptions {
  std::vector<std::filesystem::path> views;  // folders of views
  std::optional<std::filesystem::path>
      rig;  // the nominal one; else beside the first folder's lists or one folder up
  std::filesystem::path out;
};

// Writes out/report.json and out/report.html, and out/rig.json unless a gate failed (kQualityGate, which
// one). Progress goes to stderr. Returns report.json's text.
Result<std::string> RunCalibrate(const CalibrateOptions& options);

}  // namespace mixstage
