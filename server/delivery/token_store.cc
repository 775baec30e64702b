// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/token_store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <functional>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/delivery/owned_fd.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxFileBytes = 1 << 20;
constexpr std::size_t kMaxTokens = 1000;
constexpr std::size_t kMaxNameBytes = 64;

tl::unexpected<Error> Refuse(const fs::path& file, const std::string& why) {
  return Fail(ErrorCode::kInvalidConfig, file.string() + ": " + why);
}
tl::unexpected<Error> CannotWrite(const fs::path& file) {
  return Fail(ErrorCode::kUnavailable, file.string() + " cannot be written: " + std::strerror(errno));
}

bool IsName(const std::string& name) {
  return !name.empty() && name.size() <= kMaxNameBytes && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-' || c == '@';
  });
}

std::string NowUtc() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  gmtime_r(&now, &parts);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text.data();
}

// What is checked is what was opened: nothing between looking and reading.
Result<std::string> ReadPrivateFile(const fs::path& file) {
  const OwnedFd fd(open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  struct stat about {};
  if (!fd.valid() || fstat(fd.get(), &about) != 0) return Refuse(file, std::strerror(errno));
  if (!S_ISREG(about.st_mode)) return Refuse(file, "is no regular file");
  if ((about.st_mode & 077) != 0) {
    return Refuse(file, "others than its owner may open it; run: chmod 600 " + file.string());
  }
  std::string text(kMaxFileBytes + 1, '\0');
  std::size_t size = 0;
  while (size < text.size()) {
    const ssize_t got = read(fd.get(), text.data() + size, text.size() - size);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return Refuse(file, std::strerror(errno));
    if (got == 0) break;
    size += static_cast<std::size_t>(got);
  }
  if (size > kMaxFileBytes) return Refuse(file, "is longer than 1 MiB");
  text.resize(size);
  return text;
}

std::string TextField(const Json& object, const char* key) {
  const auto it = object.find(key);
  return it != object.end() && it->is_string() ? it->get<std::string>() : std::string();
}

Result<std::vector<Token>> Parse(const std::string& text, const fs::path& file) {
  const auto shallow = [](int depth, Json::parse_event_t, const Json&) { return depth <= 4; };
  const Json json = Json::parse(text, shallow, /*allow_exceptions=*/false);
  if (!json.is_object()) return Refuse(file, "is no JSON object");
  const auto version = json.find("version");
  if (version == json.end() || !version->is_number_integer() || *version != 1) {
    return Refuse(file, "version is not 1");
  }
  const auto list = json.find("tokens");
  if (list == json.end() || !list->is_array()) return Refuse(file, "tokens is no list");
  if (list->size() > kMaxTokens) return Refuse(file, "has more than 1,000 tokens");
  std::vector<Token> tokens;
  for (const Json& item : *list) {
    const std::string place = "tokens[" + std::to_string(tokens.size()) + "]";
    if (!item.is_object()) return Refuse(file, place + " is no object");
    Token token{.name = TextField(item, "name"), .created = TextField(item, "created")};
    if (!IsName(token.name)) return Refuse(file, place + ": name is not 1 to 64 letters, digits and . _ - @");
    const Result<WatchRole> role = ParseRole(TextField(item, "role"));
    if (!role) return Refuse(file, place + ": " + role.error().message);
    token.role = *role;
    const std::optional<Sha256> digest = FromHex(TextField(item, "sha256"));
    if (!digest) return Refuse(file, place + ": sha256 is not 64 hexadecimal digits");
    token.sha256 = *digest;
    for (const Token& other : tokens) {
      if (other.name == token.name) return Refuse(file, "the name " + token.name + " stands twice");
      if (other.sha256 == token.sha256) return Refuse(file, place + ": sha256 stands twice");
    }
    tokens.push_back(std::move(token));
  }
  return tokens;
}

std::string Format(const std::vector<Token>& tokens) {
  Json list = Json::array();
  for (const Token& token : tokens) {
    list.push_back({{"name", token.name},
                    {"role", RoleName(token.role)},
                    {"sha256", ToHex(token.sha256)},
                    {"created", token.created}});
  }
  return Json{{"version", 1}, {"tokens", std::move(list)}}.dump(1, ' ', false,
                                                                Json::error_handler_t::replace) +
         "\n";
}

// Whoever reads sees the old file or the new one, whole.
Status Replace(const fs::path& file, const std::string& text) {
  const fs::path fresh = file.string() + ".new";
  unlink(fresh.c_str());  // of a writer that died; the lock says that none is alive
  OwnedFd fd(open(fresh.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
  if (!fd.valid()) return CannotWrite(fresh);
  // Root who edits a service's file leaves it the service's.
  struct stat before {};
  if (stat(file.c_str(), &before) == 0 && (before.st_uid != geteuid() || before.st_gid != getegid()) &&
      fchown(fd.get(), before.st_uid, before.st_gid) != 0) {
    const Status failed = CannotWrite(file);
    unlink(fresh.c_str());
    return failed;
  }
  std::size_t written = 0;
  while (written < text.size()) {
    const ssize_t n = write(fd.get(), text.data() + written, text.size() - written);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) break;
    written += static_cast<std::size_t>(n);
  }
  if (written < text.size() || fsync(fd.get()) != 0 || rename(fresh.c_str(), file.c_str()) != 0) {
    const Status failed = CannotWrite(file);
    unlink(fresh.c_str());
    return failed;
  }
  return {};
}

// Reads, lets `change` work on the tokens, writes; alone with the folder's lock.
Status Edit(const fs::path& given, const std::function<Status(std::vector<Token>&)>& change) {
  std::error_code error;
  const fs::path file = fs::weakly_canonical(fs::absolute(given), error);  // a link stays one
  if (error) return Refuse(given, error.message());
  const OwnedFd folder(open(file.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!folder.valid() || flock(folder.get(), LOCK_EX) != 0) return CannotWrite(file);
  std::vector<Token> tokens;
  if (fs::exists(fs::symlink_status(file, error))) {
    const Result<TokenStore> store = TokenStore::Load(file);
    if (!store) return tl::unexpected(store.error());
    tokens = store->tokens();
  }
  if (Status changed = change(tokens); !changed) return changed;
  if (Status replaced = Replace(file, Format(tokens)); !replaced) return replaced;
  fsync(folder.get());
  return {};
}

}  // namespace

TokenStore::TokenStore(std::vector<Token> tokens) : tokens_(std::move(tokens)) {
  for (const Token& token : tokens_) digests_.push_back(token.sha256);
}

Result<TokenStore> TokenStore::Load(const fs::path& file) {
  const Result<std::string> text = ReadPrivateFile(file);
  if (!text) return tl::unexpected(text.error());
  Result<std::vector<Token>> tokens = Parse(*text, file);
  if (!tokens) return tl::unexpected(tokens.error());
  return TokenStore(std::move(*tokens));
}

std::optional<ViewerIdentity> TokenStore::Find(std::string_view token) const {
  if (!IsSecret(token)) return std::nullopt;
  const std::optional<std::size_t> found = FindDigest(digests_, DigestOf(token));
  if (!found) return std::nullopt;
  const Token& known = tokens_[*found];
  return ViewerIdentity{known.name, known.role, known.sha256};
}

bool TokenStore::Holds(const ViewerIdentity& identity) const {
  return std::ranges::any_of(tokens_, [&](const Token& token) {
    return token.sha256 == identity.token_sha256 && token.name == identity.name &&
           token.role == identity.role;
  });
}

Result<std::string> MakeToken(const fs::path& file, const std::string& name, WatchRole role) {
  if (!IsName(name)) {
    return Fail(ErrorCode::kInvalidConfig, "--name is not 1 to 64 letters, digits and . _ - @");
  }
  Result<std::string> secret = MakeSecret();
  if (!secret) return secret;
  const Status edited = Edit(file, [&](std::vector<Token>& tokens) -> Status {
    if (std::ranges::any_of(tokens, [&](const Token& token) { return token.name == name; })) {
      return Refuse(file, name + " has a token already; revoke it first, or choose another name");
    }
    if (tokens.size() >= kMaxTokens) return Refuse(file, "has 1,000 tokens, as many as there may be");
    tokens.push_back({name, role, DigestOf(*secret), NowUtc()});
    return {};
  });
  if (!edited) return tl::unexpected(edited.error());
  return secret;
}

Status RevokeToken(const fs::path& file, const std::string& name) {
  return Edit(file, [&](std::vector<Token>& tokens) -> Status {
    if (std::erase_if(tokens, [&](const Token& token) { return token.name == name; }) == 0) {
      return Refuse(file, "no token has the name " + name);
    }
    return {};
  });
}

}  // namespace mixstage
