// SPDX-License-Identifier: Apache-2.0
//
// A bad network between two LCM networks, in user space (no kernel module needed): what one multicast group
// hears, the other gets through a LossyChannel. Prints its counters as JSON at the end.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <csignal>
#include <cstdio>
#include <optional>
#include <string>

#include "tests/support/lossy_channel.h"

namespace {

constexpr int kQuietMs = 10;  // after so much silence, what waits to be overtaken is let go

struct Group {
  sockaddr_in address{};
  int receive = -1, send = -1;
  sockaddr_in own{};  // where `send` sends from
};

std::optional<sockaddr_in> ParseAddress(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  sockaddr_in address{};
  address.sin_family = AF_INET;
  if (colon == std::string::npos || inet_pton(AF_INET, text.substr(0, colon).c_str(), &address.sin_addr) != 1)
    return std::nullopt;
  address.sin_port = htons(static_cast<std::uint16_t>(std::atoi(text.c_str() + colon + 1)));
  return address;
}

bool OpenGroup(Group& group, int ttl) {
  group.receive = socket(AF_INET, SOCK_DGRAM, 0);
  group.send = socket(AF_INET, SOCK_DGRAM, 0);
  const int on = 1, buffer = 4 << 20;
  setsockopt(group.receive, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  setsockopt(group.receive, SOL_SOCKET, SO_REUSEPORT, &on, sizeof on);
  setsockopt(group.receive, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer);
  ip_mreq join{};
  join.imr_multiaddr = group.address.sin_addr;
  setsockopt(group.send, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
  // Connected, so that the sender's own address is known: it must not relay what it sent.
  socklen_t length = sizeof group.own;
  return bind(group.receive, reinterpret_cast<const sockaddr*>(&group.address), sizeof group.address) == 0 &&
         setsockopt(group.receive, IPPROTO_IP, IP_ADD_MEMBERSHIP, &join, sizeof join) == 0 &&
         connect(group.send, reinterpret_cast<const sockaddr*>(&group.address), sizeof group.address) == 0 &&
         getsockname(group.send, reinterpret_cast<sockaddr*>(&group.own), &length) == 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Relays one multicast group to another, losing and damaging datagrams on the way."};
  std::string from, to;
  int ttl = 0;
  bool both_ways = false;
  mixstage::LossyChannelConfig config;
  const auto share = CLI::Range(0.0, 1.0);
  app.add_option("--from", from, "ADDRESS:PORT listened to")->required();
  app.add_option("--to", to, "ADDRESS:PORT sent to")->required();
  app.add_option("--ttl", ttl, "0: this machine, 1: the link")->check(CLI::Range(0, 255));
  app.add_flag("--both-ways", both_ways, "what others send to --to goes back to --from, unharmed");
  app.add_option("--seed", config.seed);
  app.add_option("--drop", config.drop, "share lost, each by itself")->check(share);
  app.add_option("--burst-enter", config.burst_enter, "chance before a datagram that a burst begins")
      ->check(share);
  app.add_option("--burst-leave", config.burst_leave, "chance before a datagram that it ends")->check(share);
  app.add_option("--burst-loss", config.burst_loss, "share lost in a burst")->check(share);
  app.add_option("--reorder", config.reorder, "places a datagram may be overtaken by")
      ->check(CLI::Range(0, 10'000));
  app.add_option("--duplicate", config.duplicate, "share sent twice")->check(share);
  app.add_option("--truncate", config.truncate, "share cut off")->check(share);
  app.add_option("--flip", config.flip, "share with bits turned over")->check(share);
  CLI11_PARSE(app, argc, argv);

  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  const int ended = signalfd(-1, &signals, 0);

  Group a, b;
  const auto from_address = ParseAddress(from), to_address = ParseAddress(to);
  if (!from_address || !to_address) {
    std::fprintf(stderr, "lossy_relay: --from and --to are ADDRESS:PORT\n");
    return 2;
  }
  a.address = *from_address;
  b.address = *to_address;
  if (!OpenGroup(a, ttl) || !OpenGroup(b, ttl)) {
    std::perror("lossy_relay: multicast");
    return 1;
  }
  mixstage::LossyChannel channel(
      config, [&](const auto& bytes) { (void)!send(b.send, bytes.data(), bytes.size(), 0); });
  std::array<std::uint8_t, 65536> buffer;
  // What a group heard from others than this relay; less than 0: nothing more.
  auto hear = [&](const Group& group) {
    sockaddr_in source{};
    socklen_t length = sizeof source;
    while (true) {
      const ssize_t size = recvfrom(group.receive, buffer.data(), buffer.size(), MSG_DONTWAIT,
                                    reinterpret_cast<sockaddr*>(&source), &length);
      const bool own =
          source.sin_port == group.own.sin_port && source.sin_addr.s_addr == group.own.sin_addr.s_addr;
      if (size < 0 || !own) return size;
    }
  };
  std::array<pollfd, 3> wait{{{a.receive, POLLIN, 0}, {ended, POLLIN, 0}, {b.receive, POLLIN, 0}}};
  while (true) {
    const int ready = poll(wait.data(), wait.size(), channel.waiting() ? kQuietMs : -1);
    if (ready == 0) channel.Flush();
    if (wait[1].revents != 0) break;
    for (ssize_t size = 0; wait[0].revents != 0 && (size = hear(a)) >= 0;)
      channel.Send({buffer.data(), static_cast<std::size_t>(size)});
    for (ssize_t size = 0; wait[2].revents != 0 && (size = hear(b)) >= 0;)
      if (both_ways) (void)!send(a.send, buffer.data(), static_cast<std::size_t>(size), 0);
  }
  const auto& c = channel.counters();
  std::printf(
      "{\"in\": %ld, \"out\": %ld, \"dropped\": %ld, \"duplicated\": %ld, \"truncated\": %ld, \"flipped\": "
      "%ld}\n",
      c.in, c.out, c.dropped, c.duplicated, c.truncated, c.flipped);
  return 0;
}
