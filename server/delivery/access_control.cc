// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/access_control.h"

#include <sys/stat.h>

#include <algorithm>
#include <utility>

#include "proto/base/log.h"

namespace mixstage {
namespace {

constexpr std::int64_t kRefreshUs = 1'000'000;

// The token of "Bearer TOKEN"; empty for everything else.
std::string_view BearerToken(std::string_view authorization) {
  constexpr std::string_view kBearer = "bearer ";
  const auto same = [](char a, char b) {
    return a == (b >= 'A' && b <= 'Z' ? static_cast<char>(b - 'A' + 'a') : b);
  };
  if (authorization.size() != kBearer.size() + kSecretCharacters ||
      !std::equal(kBearer.begin(), kBearer.end(), authorization.begin(), same)) {
    return {};
  }
  return authorization.substr(kBearer.size());
}

}  // namespace

AccessControl::FileStamp AccessControl::FileStamp::Of(const std::filesystem::path& file) {
  struct stat about {};
  if (file.empty() || stat(file.c_str(), &about) != 0) return {};
  return {.modified_ns = about.st_mtim.tv_sec * 1'000'000'000 + about.st_mtim.tv_nsec,
          .inode = about.st_ino,
          .bytes = static_cast<std::uint64_t>(about.st_size)};
}

Status AccessControl::Open(const ListenAddress& address) {
  if (!address.loopback && (config_.token_file.empty() || config_.tls.empty())) {
    return Fail(
        ErrorCode::kInvalidConfig,
        "listen address \"" + config_.listen +
            "\" is reached from other machines, which takes login and TLS: run \"mixstage-server token make "
            "--file tokens.json --name NAME --role director\" and \"mixstage-server certificate --out tls "
            "--host THIS_HOST\", then start with \"--tokens tokens.json --tls-certificate "
            "tls/certificate.pem --tls-key tls/key.pem\"");
  }
  for (const std::string& origin : config_.origins) {
    if (!IsOrigin(origin)) {
      return Fail(ErrorCode::kInvalidConfig,
                  "origins: \"" + origin + "\" is not SCHEME://HOST[:PORT] in lower case, without a path");
    }
  }
  // The stamps first: what changes while it is being read is read again.
  token_stamp_ = FileStamp::Of(config_.token_file);
  certificate_stamp_ = FileStamp::Of(config_.tls.certificate);
  key_stamp_ = FileStamp::Of(config_.tls.key);
  if (!config_.token_file.empty()) {
    Result<TokenStore> tokens = TokenStore::Load(config_.token_file);
    if (!tokens) return tl::unexpected(tokens.error());
    tokens_ = std::move(*tokens);
    if (tokens_->tokens().empty()) {
      spdlog::warn("delivery tokens={} holds none: nobody can log in", config_.token_file.string());
    }
  }
  if (!config_.tls.empty()) {
    Result<TlsCertificate> tls = LoadTlsCertificate(config_.tls);
    if (!tls) return tl::unexpected(tls.error());
    tls_ = std::move(*tls);
  }
  return audit_.Check();
}

std::string AccessControl::Url(const ListenAddress& address, std::uint16_t port) const {
  std::string host = config_.listen.substr(0, config_.listen.rfind(':'));
  if (!address.loopback && tls_ && !tls_->names.front().starts_with('*')) host = tls_->names.front();
  return (tls_ ? "https://" : "http://") + host + ":" + std::to_string(port) + "/";
}

bool AccessControl::IsOwnHost(std::string_view host) const {
  return IsLoopbackHost(host) || IsHostAmong(host, config_.hosts) || (tls_ && IsHostAmong(host, tls_->names));
}

bool AccessControl::MayConnect(std::string_view origin, std::string_view host) const {
  return IsOwnOrigin(origin, tls_ ? "https://" : "http://", host) ||
         std::ranges::find(config_.origins, origin) != config_.origins.end();
}

AccessControl::Login AccessControl::LogIn(std::string_view authorization,
                                          const boost::asio::ip::address& from, std::int64_t now_us) {
  if (!limits_.Take(from, now_us)) return {.outcome = LoginOutcome::kTooMany};
  const std::optional<ViewerIdentity> identity =
      tokens_ ? tokens_->Find(BearerToken(authorization)) : std::nullopt;
  if (!identity) {
    audit_.AuditRefusedLogin(from.to_string(), "token");
    return {.outcome = LoginOutcome::kRefused};
  }
  Result<std::string> ticket = tickets_.Issue(*identity, now_us);
  if (!ticket) {
    spdlog::warn("delivery login=full what=\"{}\"", ticket.error().message);
    return {.outcome = LoginOutcome::kFull};
  }
  audit_.Audit(identity->name, identity->role, from.to_string(), "login");
  return {LoginOutcome::kAdmitted, std::move(*ticket), *identity};
}

std::optional<ViewerIdentity> AccessControl::Redeem(std::string_view ticket, std::int64_t now_us) {
  return tickets_.Redeem(ticket, now_us);
}

bool AccessControl::IsKnownBearer(std::string_view authorization, const boost::asio::ip::address& from,
                                  std::int64_t now_us) {
  return tokens_ && !authorization.empty() && limits_.Take(from, now_us) &&
         tokens_->Find(BearerToken(authorization)).has_value();
}

bool AccessControl::Refresh(std::int64_t now_us) {
  if (now_us < next_refresh_us_) return false;
  next_refresh_us_ = now_us + kRefreshUs;
  const FileStamp certificate = FileStamp::Of(config_.tls.certificate), key = FileStamp::Of(config_.tls.key);
  if (certificate != certificate_stamp_ || key != key_stamp_) {
    certificate_stamp_ = certificate;
    key_stamp_ = key;
    Result<TlsCertificate> tls = LoadTlsCertificate(config_.tls);
    if (tls) {
      tls_ = std::move(*tls);
      spdlog::info("delivery certificate=reloaded");
    } else {
      spdlog::warn("delivery certificate=kept error=\"{}\"", tls.error().message);
    }
  }
  const FileStamp token_file = FileStamp::Of(config_.token_file);
  if (token_file == token_stamp_) return false;
  token_stamp_ = token_file;
  Result<TokenStore> tokens = TokenStore::Load(config_.token_file);
  if (!tokens) {
    spdlog::warn("delivery tokens=kept error=\"{}\"", tokens.error().message);
    return false;
  }
  tokens_ = std::move(*tokens);
  tickets_.Keep([this](const ViewerIdentity& identity) { return MayStay(identity); });
  spdlog::info("delivery tokens={}", tokens_->tokens().size());
  return true;
}

}  // namespace mixstage
