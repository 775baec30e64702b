// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/ticket_desk.h"

#include <algorithm>
#include <vector>

namespace mixstage {

void TicketDesk::Expire(std::int64_t now_us) {
  while (!tickets_.empty() && tickets_.front().ends_us <= now_us) tickets_.pop_front();
}

Result<std::string> TicketDesk::Issue(const ViewerIdentity& identity, std::int64_t now_us) {
  Expire(now_us);
  const auto same_name = [&](const Ticket& ticket) { return ticket.identity.name == identity.name; };
  if (std::ranges::count_if(tickets_, same_name) >= static_cast<std::ptrdiff_t>(kMaxTicketsOfOne)) {
    tickets_.erase(std::ranges::find_if(tickets_, same_name));
  }
  if (tickets_.size() >= kMaxTickets) {
    return Fail(ErrorCode::kUnavailable, "too many logins wait for their WebSocket; try again in a moment");
  }
  Result<std::string> secret = MakeSecret();
  if (secret) tickets_.push_back({DigestOf(*secret), identity, now_us + kLifeUs});
  return secret;
}

std::optional<ViewerIdentity> TicketDesk::Redeem(std::string_view ticket, std::int64_t now_us) {
  Expire(now_us);
  if (!IsSecret(ticket)) return std::nullopt;
  std::vector<Sha256> digests;
  digests.reserve(tickets_.size());
  for (const Ticket& out : tickets_) digests.push_back(out.sha256);
  const std::optional<std::size_t> found = FindDigest(digests, DigestOf(ticket));
  if (!found) return std::nullopt;
  const auto used = std::next(tickets_.begin(), static_cast<std::ptrdiff_t>(*found));
  ViewerIdentity identity = std::move(used->identity);
  tickets_.erase(used);
  return identity;
}

}  // namespace mixstage
