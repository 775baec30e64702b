// SPDX-License-Identifier: Apache-2.0
//
// Login tokens (SPEC.md 4.4): who may come in, in a file of mode 0600 that holds digests, never tokens.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/result.h"
#include "server/delivery/viewer_identity.h"

namespace mixstage {

struct Token {
  std::string name{};  // 1 .. 64 letters, digits and ". _ - @"; one token a name
  WatchRole role = WatchRole::kViewer;
  Sha256 sha256{};
  std::string created{};  // UTC, "2025-01-31T12:00:00Z"
};

// The tokens of a file as it was when it was read. Immutable; any thread.
class TokenStore {
 public:
  // Fails (kInvalidConfig) with the file's name: missing, no regular file, open to others (mode), longer than
  // 1 MiB, more than 1,000 tokens, a field that is missing or wrong, a name or digest that stands twice.
  static Result<TokenStore> Load(const std::filesystem::path& file);

  // Whose token that is; nothing when it is nobody's. Takes the same time for every 43-character text.
  [[nodiscard]] std::optional<ViewerIdentity> Find(std::string_view token) const;
  // Whether who came in by a token could still do so, in the same role.
  [[nodiscard]] bool Holds(const ViewerIdentity& identity) const;
  [[nodiscard]] const std::vector<Token>& tokens() const { return tokens_; }

 private:
  explicit TokenStore(std::vector<Token> tokens);

  std::vector<Token> tokens_;
  std::vector<Sha256> digests_;  // of tokens_, one after another
};

// Editing: the file is replaced as a whole, and two who edit at the same time wait for each other (a lock on
// its folder). A new token for a name that has none, returned once and stored as its digest; the file is
// begun where it is missing. Fails (kInvalidConfig) on a bad name or one that is taken, and as Load does;
// kUnavailable when it cannot be written.
Result<std::string> MakeToken(const std::filesystem::path& file, const std::string& name, WatchRole role);
// Fails (kInvalidConfig) when no token has that name, and as above.
Status RevokeToken(const std::filesystem::path& file, const std::string& name);

}  // namespace mixstage
