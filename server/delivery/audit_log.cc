// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/audit_log.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <nlohmann/json.hpp>
#include <utility>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "server/delivery/owned_fd.h"

namespace mixstage {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxFieldBytes = 256;

std::string NowUtc() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  std::tm parts{};
  gmtime_r(&now.tv_sec, &parts);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &parts);
  std::array<char, 8> millis{};
  std::snprintf(millis.data(), millis.size(), ".%03dZ", static_cast<int>(now.tv_nsec / 1'000'000 % 1000));
  return std::string(text.data()) + millis.data();
}

std::string Dump(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

OwnedFd OpenForAppending(const std::filesystem::path& file) {
  return OwnedFd(open(file.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0600));
}

}  // namespace

Status AuditLog::Check() const {
  if (file_.empty() || OpenForAppending(file_).valid()) return {};
  return Fail(ErrorCode::kInvalidConfig,
              "audit log " + file_.string() + " cannot be written: " + std::strerror(errno));
}

void AuditLog::Audit(std::string_view name, WatchRole role, std::string_view address, std::string_view action,
                     std::string_view edit_json) {
  if (file_.empty()) return;
  const Json line = {{"time", NowUtc()},
                     {"name", name.substr(0, kMaxFieldBytes)},
                     {"role", RoleName(role)},
                     {"address", address.substr(0, kMaxFieldBytes)},
                     {"action", action.substr(0, kMaxFieldBytes)}};
  if (edit_json.empty()) return Append(Dump(line));
  // Parsed and written anew: whatever was sent, it stays on its line.
  const auto shallow = [](int depth, Json::parse_event_t, const Json&) { return depth <= 8; };
  Json edit = edit_json.size() <= kMaxLineBytes ? Json::parse(edit_json, shallow, /*allow_exceptions=*/false)
                                                : Json(Json::value_t::discarded);
  Json full = line;
  full["edit"] = edit.is_discarded() ? Json() : std::move(edit);
  std::string text = Dump(full);
  if (text.size() > kMaxLineBytes) {
    full["edit"] = nullptr;
    text = Dump(full);
  }
  Append(std::move(text));
}

void AuditLog::AuditRefusedLogin(std::string_view address, std::string_view reason) {
  if (file_.empty()) return;
  Json line = {{"time", NowUtc()},
               {"name", ""},
               {"role", ""},
               {"address", address.substr(0, kMaxFieldBytes)},
               {"action", "login_refused"},
               {"reason", reason.substr(0, kMaxFieldBytes)}};
  {
    const std::lock_guard lock(mutex_);
    if (!refused_.Take(MonotonicMicros())) {
      ++left_out_;
      return;
    }
    if (left_out_ > 0) line["left_out"] = std::exchange(left_out_, 0);
  }
  Append(Dump(line));
}

void AuditLog::Append(std::string line) {
  const std::lock_guard lock(mutex_);
  const OwnedFd fd = OpenForAppending(file_);
  // O_APPEND: a line is written in one piece, whoever else writes.
  const bool written =
      fd.valid() && write(fd.get(), line.data(), line.size()) == static_cast<ssize_t>(line.size());
  if (!written && !std::exchange(failing_, true)) {
    spdlog::warn("delivery audit=\"{}\" error=\"{}\"", file_.string(), std::strerror(errno));
  }
  if (written) failing_ = false;
}

}  // namespace mixstage
