// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/gateway.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <string_view>

#include "proto/base/check.h"
#include "proto/base/log.h"

namespace {

constexpr std::string_view kHandshake =
    "GET /watch HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n";

mixstage::Gateway& StartedGateway() {
  static mixstage::Gateway gateway({.listen = "127.0.0.1:0"}, [] { return std::string("metrics"); });
  MIX_CHECK(mixstage::StartLog("fuzz", "off") && gateway.Start());
  return gateway;
}

}  // namespace

// A real connection to the port. An odd first byte puts a good WebSocket handshake in front of the others.
// Then our half is closed, and the gateway has to close its own.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static mixstage::Gateway& gateway = StartedGateway();
  if (size < 1) return 0;
  const int s = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(gateway.port());
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  MIX_CHECK(connect(s, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  const timeval patience{.tv_sec = 5, .tv_usec = 0};
  setsockopt(s, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  if (data[0] % 2 != 0) (void)send(s, kHandshake.data(), kHandshake.size(), MSG_NOSIGNAL);
  (void)send(s, data + 1, size - 1, MSG_NOSIGNAL);
  shutdown(s, SHUT_WR);
  char answer[4096];
  ssize_t got = 0;
  while ((got = recv(s, answer, sizeof answer, 0)) > 0) {
  }
  MIX_CHECK(got == 0 || (errno != EAGAIN && errno != EWOULDBLOCK));  // a reset is an answer too
  close(s);
  return 0;
}
