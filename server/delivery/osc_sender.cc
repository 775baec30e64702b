// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/osc_sender.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <bit>
#include <cerrno>
#include <cstring>

#include "server/delivery/listen_address.h"

namespace mixstage {
namespace {

constexpr std::size_t kMostText = 200;

// Zero-terminated, filled to a multiple of four.
void AddText(std::vector<std::uint8_t>& bytes, const std::string& text) {
  for (const char c : text.substr(0, kMostText)) {
    const auto byte = static_cast<std::uint8_t>(c);
    bytes.push_back(byte >= 0x20 && byte < 0x7f ? byte : '?');
  }
  do {
    bytes.push_back(0);
  } while (bytes.size() % 4 != 0);
}

void AddFloat(std::vector<std::uint8_t>& bytes, double value) {
  const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(value));
  for (const int shift : {24, 16, 8, 0}) bytes.push_back(static_cast<std::uint8_t>(bits >> shift));
}

}  // namespace

std::vector<std::uint8_t> OscMessage(const PhysicsEvent& event) {
  std::vector<std::uint8_t> bytes;
  AddText(bytes, std::string("/mixstage/") + PhysicsEventName(event.kind));
  const auto add = [&](const Eigen::Vector3d& v) {
    for (int k = 0; k < 3; ++k) AddFloat(bytes, v[k]);
  };
  switch (event.kind) {
    case PhysicsEventKind::kTouch:
      AddText(bytes, ",ssfffffff");
      AddText(bytes, event.name);
      AddText(bytes, event.with);
      add(event.point);
      add(event.normal);
      AddFloat(bytes, event.impulse_ns);
      break;
    case PhysicsEventKind::kRest:
      AddText(bytes, ",sfff");
      AddText(bytes, event.name);
      add(event.point);
      break;
    case PhysicsEventKind::kProblem:
    case PhysicsEventKind::kMessage:
      AddText(bytes, ",ss");
      AddText(bytes, event.name);
      AddText(bytes, event.text);
      break;
  }
  return bytes;
}

Result<OscSender> OscSender::Create(const std::string& target) {
  auto address = ParseListenAddress(target);
  if (!address) return Within("osc", address.error());
  if (address->port == 0) return Fail(ErrorCode::kInvalidConfig, "osc: port 0 is nobody's: " + target);
  sockaddr_storage to{};
  socklen_t size = 0;
  auto& v4 = reinterpret_cast<sockaddr_in&>(to);
  auto& v6 = reinterpret_cast<sockaddr_in6&>(to);
  if (inet_pton(AF_INET, address->ip.c_str(), &v4.sin_addr) == 1) {
    v4.sin_family = AF_INET;
    v4.sin_port = htons(address->port);
    size = sizeof v4;
  } else if (inet_pton(AF_INET6, address->ip.c_str(), &v6.sin6_addr) == 1) {
    v6.sin6_family = AF_INET6;
    v6.sin6_port = htons(address->port);
    size = sizeof v6;
  } else {
    return Fail(ErrorCode::kInvalidConfig, "osc: " + target + " is no address");
  }
  OwnedFd udp(socket(to.ss_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (!udp.valid()) {
    return Fail(ErrorCode::kUnavailable, std::string("osc: no socket (") + std::strerror(errno) + ")");
  }
  return OscSender(std::move(udp), to, size);
}

void OscSender::Send(const PhysicsEvent& event) const {
  const std::vector<std::uint8_t> bytes = OscMessage(event);
  sendto(socket_.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&to_),
         size_);
}

}  // namespace mixstage
