// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/libav.h"

#include <array>
#include <cstdarg>
#include <cstdio>

#include "proto/base/log.h"

namespace mixstage {
namespace {

void LogLine(void*, int level, const char* format, va_list arguments) {
  if (level > AV_LOG_WARNING || !spdlog::should_log(spdlog::level::debug)) return;
  std::array<char, 256> line{};
  const int length = std::vsnprintf(line.data(), line.size(), format, arguments);
  std::string text(line.data());
  while (!text.empty() && text.back() == '\n') text.pop_back();
  if (length > 0) spdlog::debug("delivery libav=\"{}\"", text);
}

}  // namespace

std::string LibavError(int error) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  if (av_strerror(error, text.data(), text.size()) < 0) return "error " + std::to_string(error);
  return text.data();
}

void SendLibavLogToOurs() { av_log_set_callback(LogLine); }

}  // namespace mixstage
