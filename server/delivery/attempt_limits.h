// SPDX-License-Identifier: Apache-2.0
//
// How often each address may try to log in (SPEC.md 4.4: 5 a second, bursts of 10). One thread.
#pragma once

#include <boost/asio/ip/address.hpp>
#include <cstdint>
#include <map>
#include <string>

#include "server/delivery/token_bucket.h"

namespace mixstage {

// What counts as one address: an IPv4 address, an IPv6 /64 network (who has one address of it has them all).
[[nodiscard]] std::string NetworkOf(const boost::asio::ip::address& address);

class AttemptLimits {
 public:
  static constexpr double kPerSecond = 5, kBurst = 10;
  static constexpr std::size_t kMaxAddresses = 1024;

  // False when it is one attempt too many. When kMaxAddresses are known, those that have been quiet are
  // forgotten; while none has, all others share one limit. now_us never runs backwards.
  [[nodiscard]] bool Take(const boost::asio::ip::address& address, std::int64_t now_us);

 private:
  struct Address {
    TokenBucket bucket{kPerSecond, kBurst};
    std::int64_t last_us = 0;
  };
  void Forget(std::int64_t now_us);

  std::map<std::string, Address> addresses_;
  TokenBucket all_others_{kPerSecond, kBurst};
};

}  // namespace mixstage
