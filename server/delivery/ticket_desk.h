// SPDX-License-Identifier: Apache-2.0
//
// One-use tickets (SPEC.md 4.4): what a login gives and the WebSocket's first message brings back, so that
// the token itself goes over the wire once. One thread.
#pragma once

#include <cstdint>
#include <list>
#include <optional>
#include <string>
#include <string_view>

#include "proto/base/result.h"
#include "server/delivery/viewer_identity.h"

namespace mixstage {

class TicketDesk {
 public:
  static constexpr std::int64_t kLifeUs = 30'000'000;
  static constexpr std::size_t kMaxTickets = 1024;
  static constexpr std::size_t kMaxTicketsOfOne = 32;  // name; a new one then ends its oldest

  // Fails with kUnavailable while kMaxTickets are out. now_us never runs backwards.
  Result<std::string> Issue(const ViewerIdentity& identity, std::int64_t now_us);
  // Whose ticket it is, once.
  std::optional<ViewerIdentity> Redeem(std::string_view ticket, std::int64_t now_us);
  // Ends the tickets of those who may not come in any more.
  template <typename MayStay>
  void Keep(const MayStay& may_stay) {
    tickets_.remove_if([&](const Ticket& ticket) { return !may_stay(ticket.identity); });
  }

 private:
  struct Ticket {
    Sha256 sha256;
    ViewerIdentity identity;
    std::int64_t ends_us;
  };
  void Expire(std::int64_t now_us);

  std::list<Ticket> tickets_;  // the oldest first
};

}  // namespace mixstage
