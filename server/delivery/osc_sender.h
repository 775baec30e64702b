// SPDX-License-Identifier: Apache-2.0
//
// What happens to objects, for a show-control desk: Open Sound Control 1.0, one UDP datagram a message
// (SPEC.md 4.6).
#pragma once

#include <sys/socket.h>

#include <cstdint>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "server/delivery/owned_fd.h"
#include "server/physics/physics_event.h"

namespace mixstage {

// Texts are cut to 200 bytes, bytes that are no printable ASCII become '?': desks read ASCII.
[[nodiscard]] std::vector<std::uint8_t> OscMessage(const PhysicsEvent& event);

// One thread.
class OscSender {
 public:
  // target: "127.0.0.1:9000", "[::1]:9000". Fails (kInvalidConfig) on other forms and port 0, (kUnavailable)
  // without a socket.
  static Result<OscSender> Create(const std::string& target);
  // Returns at once; a datagram that the network does not take is lost, as any datagram may be.
  void Send(const PhysicsEvent& event) const;

 private:
  OscSender(OwnedFd socket, const sockaddr_storage& to, socklen_t size)
      : socket_(std::move(socket)), to_(to), size_(size) {}

  OwnedFd socket_;
  sockaddr_storage to_;
  socklen_t size_;
};

}  // namespace mixstage
