// SPDX-License-Identifier: Apache-2.0
//
// One line per event, "level module key=value ..."; none per frame (that is what the metrics are for).
#pragma once

#include <spdlog/spdlog.h>

#include <string>

#include "proto/base/result.h"

namespace mixstage {

// level: trace, debug, info, warn, error or off. Logs go to standard error, so that standard output stays
// data.
Status StartLog(const std::string& program, const std::string& level);

}  // namespace mixstage
