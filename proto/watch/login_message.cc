// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/login_message.h"

#include <algorithm>

#include "proto/watch/json_field.h"

namespace mixstage {

bool IsTokenText(std::string_view text) {
  constexpr std::size_t kTokenCharacters = 43;
  return text.size() == kTokenCharacters && std::ranges::all_of(text, [](char c) {
           return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' ||
                  c == '_';
         });
}

Result<WatchLogin> ParseLoginAnswer(std::string_view json_text) {
  if (json_text.size() > kMaxLoginAnswerBytes)
    return Fail(ErrorCode::kBadInput, "login: the answer is longer than 4,096 bytes");
  const JsonFields json = ParseBoundedJson(json_text);
  WatchLogin login;
  JsonReader read(json);
  read.Text("ticket", &login.ticket);
  read.Text("role", &login.role);
  read.Text("name", &login.name);
  if (!read.status()) return Within("login", read.status().error());
  if (!IsTokenText(login.ticket))
    return Fail(ErrorCode::kBadInput, "login: ticket is not 43 characters of base64url");
  return login;
}

}  // namespace mixstage
