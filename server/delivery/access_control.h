// SPDX-License-Identifier: Apache-2.0
//
// Who may come in, by what name, and as what (SPEC.md 4.4): tokens, tickets, the limit of attempts, Host and
// Origin, and the certificate. Only on `serve`, but for Open(), which comes before, and the audit log.
#pragma once

#include <boost/asio/ip/address.hpp>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "proto/base/result.h"
#include "server/delivery/attempt_limits.h"
#include "server/delivery/audit_log.h"
#include "server/delivery/gateway.h"
#include "server/delivery/listen_address.h"
#include "server/delivery/ticket_desk.h"
#include "server/delivery/token_store.h"

namespace mixstage {

class AccessControl {
 public:
  explicit AccessControl(const GatewayConfig& config) : config_(config), audit_(config.audit_file) {}

  // Reads tokens and certificate, checks the rest. Fails with kInvalidConfig; for an address beyond loopback
  // without both, with the commands that make them.
  Status Open(const ListenAddress& address);

  // The page's address as a person opens it: by the certificate's name where any address is listened to.
  [[nodiscard]] std::string Url(const ListenAddress& address, std::uint16_t port) const;
  [[nodiscard]] bool login_needed() const { return tokens_.has_value(); }
  // Nothing where the gateway speaks plainly. New connections take the newest certificate.
  [[nodiscard]] boost::asio::ssl::context* tls() const { return tls_ ? tls_->context.get() : nullptr; }
  // A Host header's value is a name of this server.
  [[nodiscard]] bool IsOwnHost(std::string_view host) const;
  // An Origin header's value is this server's page, as it was called, or one of the configured.
  [[nodiscard]] bool MayConnect(std::string_view origin, std::string_view host) const;

  enum class LoginOutcome { kAdmitted = 1, kRefused, kTooMany, kFull };
  struct Login {
    LoginOutcome outcome = LoginOutcome::kRefused;
    std::string ticket{};  // the rest only when admitted
    ViewerIdentity identity{};
  };
  // authorization: the header's value, "Bearer TOKEN".
  Login LogIn(std::string_view authorization, const boost::asio::ip::address& from, std::int64_t now_us);
  std::optional<ViewerIdentity> Redeem(std::string_view ticket, std::int64_t now_us);
  // A bearer token that would log in, where /metrics is asked for from elsewhere; attempts count like logins.
  [[nodiscard]] bool IsKnownBearer(std::string_view authorization, const boost::asio::ip::address& from,
                                   std::int64_t now_us);

  // Reads again, once a second, what has changed on the disk; a file that is broken or gone changes nothing,
  // and a warning says so. True when the tokens are others: then whoever MayStay() denies must go.
  [[nodiscard]] bool Refresh(std::int64_t now_us);
  [[nodiscard]] bool MayStay(const ViewerIdentity& identity) const {
    return !tokens_ || tokens_->Holds(identity);
  }

  [[nodiscard]] AuditLog& audit() { return audit_; }

 private:
  // When a file was written and which one it is: a replaced file has another inode though its time be the
  // same.
  struct FileStamp {
    std::int64_t modified_ns = 0;
    std::uint64_t inode = 0, bytes = 0;
    bool operator==(const FileStamp&) const = default;
    static FileStamp Of(const std::filesystem::path& file);
  };

  const GatewayConfig& config_;
  AuditLog audit_;
  std::optional<TokenStore> tokens_;
  std::optional<TlsCertificate> tls_;
  FileStamp token_stamp_, certificate_stamp_, key_stamp_;
  std::int64_t next_refresh_us_ = 0;
  TicketDesk tickets_;
  AttemptLimits limits_;
};

}  // namespace mixstage
