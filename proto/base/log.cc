// SPDX-License-Identifier: Apache-2.0
#include "proto/base/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>

#include <memory>

namespace mixstage {

Status StartLog(const std::string& program, const std::string& level) {
  const spdlog::level::level_enum parsed = spdlog::level::from_str(level);
  if (parsed == spdlog::level::off && level != "off") {
    return Fail(ErrorCode::kInvalidConfig,
                "--log-level " + level + " is none of trace, debug, info, warn, error, off");
  }
  auto logger =
      std::make_shared<spdlog::logger>(program, std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %^%l%$ %n %v");
  logger->set_level(parsed);
  spdlog::set_default_logger(std::move(logger));
  return {};
}

}  // namespace mixstage
