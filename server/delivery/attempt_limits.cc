// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/attempt_limits.h"

#include <algorithm>

namespace mixstage {
namespace {

// After so long a bucket is full again: forgetting it changes nothing.
constexpr auto kRefilledUs =
    static_cast<std::int64_t>(1e6 * AttemptLimits::kBurst / AttemptLimits::kPerSecond);

}  // namespace

std::string NetworkOf(const boost::asio::ip::address& address) {
  if (address.is_v4()) return address.to_string();
  const boost::asio::ip::address_v6 v6 = address.to_v6();
  if (v6.is_v4_mapped()) {
    return boost::asio::ip::make_address_v4(boost::asio::ip::v4_mapped, v6).to_string();
  }
  boost::asio::ip::address_v6::bytes_type network = v6.to_bytes();
  std::fill(network.begin() + 8, network.end(), std::uint8_t{0});
  return boost::asio::ip::address_v6(network).to_string() + "/64";
}

void AttemptLimits::Forget(std::int64_t now_us) {
  std::erase_if(addresses_, [&](const auto& entry) { return now_us - entry.second.last_us >= kRefilledUs; });
}

bool AttemptLimits::Take(const boost::asio::ip::address& address, std::int64_t now_us) {
  const std::string key = NetworkOf(address);
  auto known = addresses_.find(key);
  if (known == addresses_.end()) {
    if (addresses_.size() >= kMaxAddresses) Forget(now_us);
    if (addresses_.size() >= kMaxAddresses) return all_others_.Take(now_us);
    known = addresses_.emplace(key, Address()).first;
  }
  known->second.last_us = now_us;
  return known->second.bucket.Take(now_us);
}

}  // namespace mixstage
