// SPDX-License-Identifier: Apache-2.0
//
// The answer to POST /login (SPEC.md 4.4).
#pragma once

#include <string>
#include <string_view>

#include "proto/base/result.h"

namespace mixstage {

inline constexpr std::size_t kMaxLoginAnswerBytes = 4096;

// Tokens and tickets alike: 43 characters of base64url, 256 bits.
[[nodiscard]] bool IsTokenText(std::string_view text);

struct WatchLogin {
  std::string ticket;  // serves once
  std::string role;    // "viewer" or "director"
  std::string name;    // of the token, for people
};
// Fails (kBadInput) on anything but the JSON of the specification; the ticket is one by IsTokenText.
Result<WatchLogin> ParseLoginAnswer(std::string_view json_text);

}  // namespace mixstage
