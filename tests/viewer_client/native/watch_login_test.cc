// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <thread>

#include "proto/watch/login_message.h"
#include "server/delivery/gateway.h"
#include "tests/server/delivery/test_viewer.h"
#include "tests/viewer_client/native/login_server.h"
#include "viewer_client/native/watch_client.h"

namespace mixstage {
namespace {

const std::string kToken(43, 'k');
const std::string kOtherToken(43, 'o');

// A client that watches on a thread of its own until it is destroyed or refused.
class Watcher {
 public:
  explicit Watcher(WatchClientConfig config) {
    config.shortest_backoff_s = 0.02;
    config.longest_backoff_s = 0.1;
    WatchCallbacks callbacks;
    callbacks.on_connected = [this] { ++connected; };
    callbacks.on_disconnected = [this](const std::string& why) {
      const std::lock_guard lock(mutex_);
      why_ = why;
      ++disconnected;
    };
    client_ = *WatchClient::Create(std::move(config), std::move(callbacks));
    thread_ = std::jthread([this](const std::stop_token& stop) { end = client_->Run(stop); });
  }
  [[nodiscard]] std::string why() const {
    const std::lock_guard lock(mutex_);
    return why_;
  }
  std::atomic<int> connected{0}, disconnected{0};
  std::atomic<WatchEnd> end{};

 private:
  mutable std::mutex mutex_;
  std::string why_;
  std::unique_ptr<WatchClient> client_;
  std::jthread thread_;
};

std::string Url(const char* scheme, std::uint16_t port, const char* host = "localhost") {
  return std::string(scheme) + "://" + host + ":" + std::to_string(port) + "/";
}

class CaFile {
 public:
  explicit CaFile(const std::string& pem) { std::ofstream(file_) << pem; }
  ~CaFile() { std::filesystem::remove(file_); }
  [[nodiscard]] std::string path() const { return file_.string(); }

 private:
  const std::filesystem::path file_ =
      std::filesystem::temp_directory_path() / ("mixstage_ca_" + std::to_string(getpid()) + ".pem");
};

TEST(WatchLogin, ATokenBecomesATicketAndEveryConnectionHasItsOwn) {
  LoginServer server(kToken);
  const Watcher watcher({.url = Url("http", server.port()), .token = kToken});
  ASSERT_TRUE(Eventually([&] { return watcher.connected == 1; }));
  server.CloseViewers();
  EXPECT_TRUE(Eventually([&] { return watcher.connected == 2; }));
  EXPECT_EQ(server.logins, 2);
}

TEST(WatchLogin, AWrongTokenEndsItAndIsNotTriedAgain) {
  LoginServer server(kToken);
  const Watcher watcher({.url = Url("http", server.port()), .token = kOtherToken});
  ASSERT_TRUE(Eventually([&] { return watcher.end.load() == WatchEnd::kLoginRefused; }));
  EXPECT_EQ(server.refused, 1);
  EXPECT_EQ(watcher.connected, 0);
  EXPECT_NE(watcher.why().find("token"), std::string::npos);
}

TEST(WatchLogin, WithoutATokenTheServersGoodbyeSaysWhatIsMissing) {
  LoginServer server(kToken);
  const Watcher watcher({.url = Url("http", server.port())});
  ASSERT_TRUE(Eventually([&] { return watcher.end.load() == WatchEnd::kLoginRefused; }));
  EXPECT_EQ(watcher.why(), "the server asks for a login");
}

TEST(WatchLogin, ATicketThatTheServerForgotIsFetchedAnew) {
  LoginServer server(kToken);
  server.ForgetTickets();
  const Watcher watcher({.url = Url("http", server.port()), .token = kToken});
  EXPECT_TRUE(Eventually([&] { return watcher.connected == 1; }));
  EXPECT_EQ(server.logins, 2);
}

TEST(WatchLogin, ARevokedTokenEndsTheWatching) {
  LoginServer server(kToken);
  const Watcher watcher({.url = Url("http", server.port()), .token = kToken});
  ASSERT_TRUE(Eventually([&] { return watcher.connected == 1; }));
  server.Revoke();
  server.CloseViewers();
  EXPECT_TRUE(Eventually([&] { return watcher.end.load() == WatchEnd::kLoginRefused; }));
}

TEST(WatchLogin, ATokenDoesNoHarmWhereNoneIsAsked) {
  Gateway gateway({.listen = "127.0.0.1:0"});
  ASSERT_TRUE(gateway.Start());
  gateway.SetHello({.name = "open", .server_us = 0, .streams = {}});
  const Watcher watcher({.url = Url("http", gateway.port()), .token = kToken});
  EXPECT_TRUE(Eventually([&] { return watcher.connected == 1; })) << watcher.why();
}

TEST(WatchTls, TheAuthoritysFileOpensTheDoor) {
  const TestCertificate certificate = MakeTestCertificate("localhost");
  const CaFile ca(certificate.certificate_pem);
  LoginServer server(kToken, certificate);
  const Watcher watcher({.url = Url("https", server.port()), .token = kToken, .ca_file = ca.path()});
  ASSERT_TRUE(Eventually([&] { return watcher.connected == 1; })) << watcher.why();
  server.CloseViewers();
  EXPECT_TRUE(Eventually([&] { return watcher.connected == 2; })) << watcher.why();
}

TEST(WatchTls, AStrangersCertificateIsRefusedBeforeTheTokenIsSent) {
  LoginServer server(kToken, MakeTestCertificate("localhost"));
  const Watcher watcher({.url = Url("https", server.port()), .token = kToken});
  ASSERT_TRUE(Eventually([&] { return watcher.disconnected > 1; })) << "it goes on trying";
  EXPECT_NE(watcher.why().find("not trusted"), std::string::npos) << watcher.why();
  EXPECT_EQ(server.logins + server.refused, 0);
}

TEST(WatchTls, ACertificateForAnotherHostIsRefused) {
  const TestCertificate certificate = MakeTestCertificate("other.example");
  const CaFile ca(certificate.certificate_pem);
  LoginServer server(kToken, certificate);
  const Watcher watcher({.url = Url("wss", server.port()), .token = kToken, .ca_file = ca.path()});
  ASSERT_TRUE(Eventually([&] { return watcher.disconnected > 0; }));
  EXPECT_EQ(watcher.connected, 0);
  EXPECT_EQ(server.logins, 0);
}

TEST(WatchTls, UncheckedItTakesAnyCertificate) {
  LoginServer server(kToken, MakeTestCertificate("other.example"));
  const Watcher watcher({.url = Url("https", server.port()), .token = kToken, .tls_check = TlsCheck::kNone});
  EXPECT_TRUE(Eventually([&] { return watcher.connected == 1; })) << watcher.why();
}

TEST(LoginAnswer, OnlyAWholeAnswerIsOne) {
  const std::string ticket(43, 'A');
  const auto answer = [](const std::string& t) {
    return R"({"ticket": ")" + t + R"(", "role": "viewer", "name": "anna", "later": 1})";
  };
  ASSERT_TRUE(ParseLoginAnswer(answer(ticket)));
  EXPECT_EQ(ParseLoginAnswer(answer(ticket))->ticket, ticket);
  EXPECT_EQ(ParseLoginAnswer(answer(ticket))->name, "anna");
  for (const std::string& bad : {std::string(), std::string("{}"), std::string("[1]"), answer("short"),
                                 answer(std::string(42, 'A') + "+"), answer(std::string(5000, 'A')),
                                 std::string(R"({"ticket": 5, "role": "viewer", "name": "x"})")}) {
    EXPECT_FALSE(ParseLoginAnswer(bad)) << bad.substr(0, 60);
  }
}

}  // namespace
}  // namespace mixstage
