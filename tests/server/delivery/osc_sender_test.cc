// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/osc_sender.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>

#include <string>

namespace mixstage {
namespace {

// As python-osc reads and writes it.
TEST(OscSender, ATouchIsOneMessageOfOsc) {
  PhysicsEvent event{.kind = PhysicsEventKind::kTouch, .name = "vase", .with = "floor"};
  event.point = {1, -2, 0};
  event.normal = {0, 0, 1};
  event.impulse_ns = 0.5;
  const std::vector<std::uint8_t> bytes = OscMessage(event);
  const std::string expected(
      "/mixstage/touch\0,ssfffffff\0\0vase\0\0\0\0floor\0\0\0"
      "\x3f\x80\0\0\xc0\0\0\0\0\0\0\0"
      "\0\0\0\0\0\0\0\0\x3f\x80\0\0"
      "\x3f\0\0\0",
      72);
  EXPECT_EQ(std::string(bytes.begin(), bytes.end()), expected);
}

TEST(OscSender, NamesOfAnyLengthAndBytesStayAscii) {
  PhysicsEvent event{
      .kind = PhysicsEventKind::kProblem, .name = std::string(1000, 'x'), .text = "a\nb\xc3\xa4"};
  const std::vector<std::uint8_t> bytes = OscMessage(event);
  EXPECT_EQ(bytes.size() % 4, 0u);
  EXPECT_LT(bytes.size(), 300u);
  EXPECT_NE(std::string(bytes.begin(), bytes.end()).find("a?b??"), std::string::npos);
}

TEST(OscSender, ADatagramArrivesAndWrongTargetsAreRefused) {
  const int receiver = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in at{};
  at.sin_family = AF_INET;
  at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(bind(receiver, reinterpret_cast<sockaddr*>(&at), sizeof at), 0);
  socklen_t size = sizeof at;
  getsockname(receiver, reinterpret_cast<sockaddr*>(&at), &size);
  const auto sender = OscSender::Create("127.0.0.1:" + std::to_string(ntohs(at.sin_port)));
  ASSERT_TRUE(sender);
  const PhysicsEvent event{.kind = PhysicsEventKind::kRest, .name = "vase"};
  sender->Send(event);
  std::vector<std::uint8_t> got(2000);
  const timeval patience{.tv_sec = 2, .tv_usec = 0};
  setsockopt(receiver, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  got.resize(static_cast<std::size_t>(std::max<ssize_t>(0, recv(receiver, got.data(), got.size(), 0))));
  close(receiver);
  EXPECT_EQ(got, OscMessage(event));
  for (const char* wrong : {"", "desk:9000", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:99999"}) {
    EXPECT_FALSE(OscSender::Create(wrong)) << wrong;
  }
}

}  // namespace
}  // namespace mixstage
