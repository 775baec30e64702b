// SPDX-License-Identifier: Apache-2.0
//
// Who came in and who changed what: one JSON object a line (SPEC.md 4.4), appended. Tokens and tickets are
// never handed to it.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <string>
#include <string_view>

#include "proto/base/result.h"
#include "proto/watch/text_message.h"
#include "server/delivery/token_bucket.h"

namespace mixstage {

class AuditLog {
 public:
  static constexpr std::size_t kMaxLineBytes = 8192;

  // Writes nowhere when `file` is empty.
  explicit AuditLog(std::filesystem::path file = {}) : file_(std::move(file)) {}
  // Begins the file (mode 0600) where it is missing. Fails (kInvalidConfig) when it cannot be appended to.
  Status Check() const;

  // One line. edit_json: the edit as it was sent, or empty; what is no JSON or makes the line too long
  // becomes null. The file is opened anew for each line, so it may be moved away at any time. When the disk
  // is full the show goes on: a warning, once until it works again. Any thread.
  void Audit(std::string_view name, WatchRole role, std::string_view address, std::string_view action,
             std::string_view edit_json = {});
  // The line of somebody without a name. Those beyond 20 a second are counted in the next one's "left_out".
  void AuditRefusedLogin(std::string_view address, std::string_view reason);

 private:
  void Append(std::string line);

  const std::filesystem::path file_;
  std::mutex mutex_;
  TokenBucket refused_{20, 40};
  std::uint64_t left_out_ = 0;
  bool failing_ = false;
};

}  // namespace mixstage
