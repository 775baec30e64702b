// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string_view>

#include "server/pipeline/frame.h"
#include "server/pipeline/studio.h"

namespace mixstage {

// A stage as people see it: in the report, the metrics, the logs and on the page.
struct StageInfo {
  std::string_view name;
  double budget_ms = 0;     // core-ms per 1024x768 frame
  std::string_view thread;  // that owns it live
  std::string_view source;  // section or equation of the paper
};

// From the camera's bytes to the viewers, in order: those of other threads and the table of frame stages.
std::span<const StageInfo> AllStages();

}  // namespace mixstage
