// SPDX-License-Identifier: Apache-2.0
//
// Login over real sockets, plain and by TLS; strangers at the TLS port.
#include <gtest/gtest.h>
#include <openssl/ssl.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "server/delivery/gateway.h"
#include "server/delivery/token_store.h"
#include "tests/server/delivery/test_viewer.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

class GatewayLogin : public testing::Test {
 protected:
  GatewayLogin() : folder_(fs::temp_directory_path() / ("mixstage_login_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
    anna_ = MakeToken(folder_ / "tokens.json", "anna", WatchRole::kDirector).value();
    ben_ = MakeToken(folder_ / "tokens.json", "ben", WatchRole::kViewer).value();
    EXPECT_TRUE(MakeSelfSignedCertificate(folder_ / "tls", {"localhost", "studio.example"}));
  }
  ~GatewayLogin() override { fs::remove_all(folder_); }

  GatewayConfig Plain() const {
    return {.listen = "127.0.0.1:0",
            .token_file = folder_ / "tokens.json",
            .audit_file = folder_ / "audit.jsonl"};
  }
  GatewayConfig Tls() const {
    GatewayConfig config = Plain();
    config.tls = {folder_ / "tls/certificate.pem", folder_ / "tls/key.pem"};
    return config;
  }
  static std::string LoginRequest(const std::string& token, const std::string& more = "") {
    return "POST /login HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Length: 0\r\n"
           "Authorization: Bearer " +
           token + "\r\n" + more + "\r\n";
  }
  static nlohmann::json Body(const std::string& response) {
    const std::size_t end = response.find("\r\n\r\n");
    return nlohmann::json::parse(end == std::string::npos ? "" : response.substr(end + 4), nullptr, false);
  }
  static std::string Ticket(std::uint16_t port, const std::string& token) {
    return Body(RawRequest(port, LoginRequest(token)))["ticket"].get<std::string>();
  }
  std::string Audited() const {
    std::ostringstream text;
    text << std::ifstream(folder_ / "audit.jsonl").rdbuf();
    return text.str();
  }

  const fs::path folder_;
  std::string anna_, ben_;
};

TEST_F(GatewayLogin, ATokenGivesATicketAndTheTicketTheRole) {
  Gateway gateway(Plain());
  ASSERT_TRUE(gateway.Start());
  for (const auto& [token, name, role] :
       {std::tuple{anna_, "anna", "director"}, std::tuple{ben_, "ben", "viewer"}}) {
    const std::string response = RawRequest(gateway.port(), LoginRequest(token));
    EXPECT_TRUE(response.starts_with("HTTP/1.1 200")) << response;
    EXPECT_NE(response.find("Cache-Control: no-store\r\n"), std::string::npos);
    const nlohmann::json body = Body(response);
    EXPECT_EQ(body["name"], name);
    EXPECT_EQ(body["role"], role);
    TestViewer viewer(gateway.port(), {.ticket = body["ticket"]});
    const auto hello = viewer.Read();
    ASSERT_TRUE(hello);
    EXPECT_NE(hello->bytes.find(std::string(R"("role":")") + role), std::string::npos) << hello->bytes;
  }
  EXPECT_EQ(gateway.counters().logins, 2u);
}

TEST_F(GatewayLogin, WithoutTokensEveryoneIsADirectorAndThereIsNoLogin) {
  Gateway gateway({.listen = "127.0.0.1:0"});
  ASSERT_TRUE(gateway.Start());
  EXPECT_TRUE(RawRequest(gateway.port(), LoginRequest(anna_)).starts_with("HTTP/1.1 404"));
  TestViewer viewer(gateway.port());
  const auto hello = viewer.Read();
  ASSERT_TRUE(hello);
  EXPECT_NE(hello->bytes.find(R"("role":"director")"), std::string::npos);
}

TEST_F(GatewayLogin, HealthSaysThatALoginIsNeeded) {
  Gateway gateway(Plain());
  ASSERT_TRUE(gateway.Start());
  EXPECT_NE(HttpGet(gateway.port(), "/healthz").find(R"("login":true)"), std::string::npos);
}

TEST_F(GatewayLogin, NothingIsSentBeforeTheTicketAndNobodyWaitsForLong) {
  GatewayConfig config = Plain();
  config.login_timeout_s = 1;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  gateway.SetHello({.name = "secret show"});
  TestViewer silent(gateway.port());
  ASSERT_TRUE(silent.connected());
  gateway.PublishStats(ToJson(WatchStats{.state = "live"}));
  gateway.Publish(MakeWatchPicture({.key_frame = true}, std::vector<std::uint8_t>(100)));
  EXPECT_FALSE(silent.Read()) << "neither hello nor stats nor pictures";
  EXPECT_EQ(silent.ReadCloseCode(), 1008);
  EXPECT_EQ(gateway.counters().closed_login, 1u);
  EXPECT_EQ(gateway.counters().viewers, 0u);
  EXPECT_FALSE(gateway.WantsStream(WatchStream::kColor));
}

TEST_F(GatewayLogin, OtherFirstMessagesAndUsedTicketsClose) {
  Gateway gateway(Plain());
  ASSERT_TRUE(gateway.Start());
  const std::string ticket = Ticket(gateway.port(), ben_);
  TestViewer good(gateway.port(), {.ticket = ticket});
  ASSERT_TRUE(good.Read());
  TestViewer again(gateway.port(), {.ticket = ticket});
  EXPECT_EQ(again.ReadCloseCode(), 1008);
  for (const std::string& text : {std::string("{"), std::string(R"({"type":"ping","viewer_us":1})"),
                                  std::string(R"({"type":"ticket"})"),
                                  R"({"type":"ticket","ticket":")" + std::string(43, 'A') + R"("})",
                                  R"({"type":"ticket","ticket":")" + ben_ + R"("})"}) {
    TestViewer viewer(gateway.port());
    viewer.SendText(text);
    EXPECT_FALSE(viewer.Read());
    EXPECT_EQ(viewer.ReadCloseCode(), 1008) << text;
  }
  EXPECT_EQ(gateway.counters().closed_login, 6u);
}

TEST_F(GatewayLogin, WrongTokensAndTooManyAttemptsAreRefused) {
  Gateway gateway(Plain());
  ASSERT_TRUE(gateway.Start());
  const std::string wrong = RawRequest(gateway.port(), LoginRequest(std::string(43, 'A')));
  EXPECT_TRUE(wrong.starts_with("HTTP/1.1 401")) << wrong;
  EXPECT_NE(wrong.find("WWW-Authenticate: Bearer\r\n"), std::string::npos);
  bool limited = false;
  for (int i = 0; i < 200 && !limited; ++i)
    limited = RawRequest(gateway.port(), LoginRequest(std::string(43, 'A'))).starts_with("HTTP/1.1 429");
  EXPECT_TRUE(limited);
  EXPECT_TRUE(
      RawRequest(gateway.port(), "POST /login HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n")
          .starts_with("HTTP/1.1 403"));
  EXPECT_TRUE(RawRequest(gateway.port(), LoginRequest(anna_, "Origin: http://evil.example\r\n"))
                  .starts_with("HTTP/1.1 403"));
  EXPECT_TRUE(
      RawRequest(gateway.port(), "GET /login HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
          .starts_with("HTTP/1.1 404"));
}

TEST_F(GatewayLogin, ARevokedTokensViewersAreClosedAndOthersStay) {
  Gateway gateway(Plain());
  ASSERT_TRUE(gateway.Start());
  TestViewer anna(gateway.port(), {.ticket = Ticket(gateway.port(), anna_)});
  TestViewer ben(gateway.port(), {.ticket = Ticket(gateway.port(), ben_)});
  ASSERT_TRUE(anna.Read() && ben.Read());
  ASSERT_TRUE(RevokeToken(folder_ / "tokens.json", "ben"));
  EXPECT_EQ(ben.ReadCloseCode(), 1008);
  EXPECT_TRUE(anna.SendText(R"({"type":"ping","viewer_us":1})"));
  EXPECT_TRUE(anna.ReadText("pong"));
  EXPECT_TRUE(RawRequest(gateway.port(), LoginRequest(ben_)).starts_with("HTTP/1.1 401"));
}

TEST_F(GatewayLogin, ASilentViewerIsClosedAndOneThatPingsStays) {
  GatewayConfig config = Plain();
  config.idle_timeout_s = 2;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  TestViewer silent(gateway.port(), {.ticket = Ticket(gateway.port(), ben_)});
  TestViewer pinging(gateway.port(), {.ticket = Ticket(gateway.port(), anna_)});
  while (gateway.counters().closed_idle == 0 && pinging.SendText(R"({"type":"ping","viewer_us":1})"))
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_EQ(silent.ReadCloseCode(), 1008);
  EXPECT_TRUE(pinging.SendText(R"({"type":"ping","viewer_us":77})"));
  EXPECT_TRUE(pinging.ReadText("77")) << "and the one that pings is still there";
}

TEST_F(GatewayLogin, MetricsAreForThisMachineOrABearer) {
  Gateway gateway(Plain(), [] { return std::string("mixstage_frames_total 7\n"); });
  ASSERT_TRUE(gateway.Start());
  EXPECT_NE(HttpGet(gateway.port(), "/metrics").find("mixstage_frames_total 7"), std::string::npos);
  // What a proxy on this machine passes on comes from elsewhere.
  const std::string forwarded = "X-Forwarded-For: 192.0.2.1\r\n";
  EXPECT_TRUE(HttpGet(gateway.port(), "/metrics", forwarded).starts_with("HTTP/1.1 401"));
  EXPECT_TRUE(HttpGet(gateway.port(), "/metrics",
                      forwarded + "Authorization: Bearer " + std::string(43, 'A') + "\r\n")
                  .starts_with("HTTP/1.1 401"));
  EXPECT_NE(HttpGet(gateway.port(), "/metrics", forwarded + "Authorization: Bearer " + ben_ + "\r\n")
                .find("mixstage_frames_total 7"),
            std::string::npos);
}

TEST_F(GatewayLogin, TheAuditLogNamesWhoCameAndNeverASecret) {
  GatewayConfig config = Plain();
  config.edits = std::make_shared<EditQueue>(kMaxWaitingEdits, WhenFull::kDropOldest);
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  const std::string ticket = Ticket(gateway.port(), anna_);
  TestViewer viewer(gateway.port(), {.ticket = ticket});
  ASSERT_TRUE(viewer.Read());
  RawRequest(gateway.port(), LoginRequest(std::string(42, 'A') + "B"));
  const std::string edit = ToJson(WatchEdit{.id = 5, .op = UndoEdit{}});
  ASSERT_TRUE(viewer.SendText(edit));
  ASSERT_TRUE(config.edits->PopFor(std::chrono::seconds(5)));
  const std::string lines = Audited();
  EXPECT_NE(lines.find(R"("name":"anna","role":"director","address":"127.0.0.1","action":"login")"),
            std::string::npos)
      << lines;
  EXPECT_NE(lines.find(R"("action":"login_refused")"), std::string::npos);
  EXPECT_NE(
      lines.find(R"("name":"anna","role":"director","address":"127.0.0.1","action":"edit","edit":)" + edit),
      std::string::npos)
      << lines;
  for (const std::string& secret : {anna_, ticket, std::string(42, 'A')})
    EXPECT_EQ(lines.find(secret), std::string::npos);
}

TEST_F(GatewayLogin, TlsServesPageLoginAndPictures) {
  Gateway gateway(Tls());
  ASSERT_TRUE(gateway.Start());
  EXPECT_EQ(gateway.url(), "https://127.0.0.1:" + std::to_string(gateway.port()) + "/");
  const std::string health = TlsRequest(
      gateway.port(), "GET /healthz HTTP/1.1\r\nHost: studio.example\r\nConnection: close\r\n\r\n");
  EXPECT_TRUE(health.starts_with("HTTP/1.1 200")) << health;
  EXPECT_NE(health.find("Strict-Transport-Security: "), std::string::npos);
  EXPECT_TRUE(TlsRequest(gateway.port(), "GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n")
                  .starts_with("HTTP/1.1 403"));
  const nlohmann::json login = Body(TlsRequest(gateway.port(), LoginRequest(anna_)));
  TlsTestViewer viewer(gateway.port(), {.origin = "https://127.0.0.1:" + std::to_string(gateway.port()),
                                        .ticket = login["ticket"]});
  ASSERT_TRUE(viewer.Read());
  // Larger than a TLS record and than the socket's buffer.
  const std::vector<std::uint8_t> payload(2'000'000, 0x42);
  const auto picture = MakeWatchPicture({.key_frame = true}, payload);
  gateway.Publish(picture);
  const auto received = viewer.ReadBinary();
  ASSERT_TRUE(received);
  EXPECT_EQ(std::vector<std::uint8_t>(received->bytes.begin(), received->bytes.end()), picture->message);
  EXPECT_FALSE(TlsTestViewer(gateway.port(), {.origin = "http://127.0.0.1:" + std::to_string(gateway.port())})
                   .connected())
      << "the plain page of the same name is another origin";
  std::thread stopper([&] { gateway.Stop(); });
  EXPECT_EQ(viewer.ReadCloseCode(), 1001);
  stopper.join();
}

TEST_F(GatewayLogin, StrangersAtTheTlsPortAreCutOffAndHoldUpNobody) {
  GatewayConfig config = Tls();
  config.request_timeout_s = 1;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  boost::asio::io_context io;
  std::vector<PlainStream> held;
  const std::string half_hello("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11);
  for (const std::string& bytes :
       {std::string(), half_hello, half_hello + std::string(100, '\0'), std::string("GET / HTTP/1.1\r\n\r\n"),
        std::string(5000, '\xff'), std::string("\x16\x03\x01\xff\xff", 5),
        std::string("\x80\x2e\x01\x00\x02", 5)}) {
    for (int i = 0; i < 4; ++i) {
      held.emplace_back(io);
      held.back().connect({boost::asio::ip::make_address("127.0.0.1"), gateway.port()});
      boost::system::error_code ignored;
      boost::asio::write(held.back(), boost::asio::buffer(bytes), ignored);
    }
  }
  EXPECT_NE(
      TlsRequest(gateway.port(), "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"),
      "");
  EXPECT_TRUE(Eventually([&] { return gateway.counters().connections == 0; })) << "and half handshakes end";
}

TEST_F(GatewayLogin, OneAddressCannotTakeEveryPlaceButItsViewersDoNotCount) {
  GatewayConfig config = Plain();
  config.max_strangers = 3;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  std::vector<std::unique_ptr<TestViewer>> viewers;
  for (int i = 0; i < 6; ++i) {
    viewers.push_back(std::make_unique<TestViewer>(
        gateway.port(), TestViewer::Options{.ticket = Ticket(gateway.port(), anna_)}));
    ASSERT_TRUE(viewers.back()->Read()) << i;
  }
  boost::asio::io_context io;
  std::vector<PlainStream> silent;
  for (int i = 0; i < 10; ++i) {
    silent.emplace_back(io);
    silent.back().connect({boost::asio::ip::make_address("127.0.0.1"), gateway.port()});
  }
  EXPECT_TRUE(Eventually([&] { return gateway.counters().refused_full >= 7; }));
  EXPECT_LE(gateway.counters().connections, 9u);
  silent.clear();
  EXPECT_TRUE(Eventually([&] { return HttpGet(gateway.port(), "/healthz").starts_with("HTTP/1.1 200"); }));
}

TEST_F(GatewayLogin, OldTlsAndRenegotiationAreRefused) {
  Gateway gateway(Tls());
  ASSERT_TRUE(gateway.Start());
  const auto handshake = [&](int version, bool renegotiate) {
    boost::asio::io_context io;
    boost::asio::ssl::context tls(boost::asio::ssl::context::tls_client);
    SSL_CTX_set_min_proto_version(tls.native_handle(), version);
    SSL_CTX_set_max_proto_version(tls.native_handle(), version);
    SSL_CTX_set_security_level(tls.native_handle(), 0);
    TlsStream stream(io, tls);
    stream.next_layer().connect({boost::asio::ip::make_address("127.0.0.1"), gateway.port()});
    boost::system::error_code error;
    stream.handshake(TlsStream::client, error);
    if (error || !renegotiate) return !error;
    if (SSL_renegotiate(stream.native_handle()) != 1) return false;
    stream.handshake(TlsStream::client, error);
    return !error;
  };
  EXPECT_FALSE(handshake(TLS1_VERSION, false));
  EXPECT_FALSE(handshake(TLS1_1_VERSION, false));
  EXPECT_TRUE(handshake(TLS1_2_VERSION, false));
  EXPECT_TRUE(handshake(TLS1_3_VERSION, false));
  EXPECT_FALSE(handshake(TLS1_2_VERSION, true));
}

TEST_F(GatewayLogin, ANewCertificateServesNewConnectionsAndOldOnesGoOn) {
  Gateway gateway(Tls());
  ASSERT_TRUE(gateway.Start());
  const nlohmann::json login = Body(TlsRequest(gateway.port(), LoginRequest(anna_)));
  TlsTestViewer viewer(gateway.port(), {.ticket = login["ticket"]});
  ASSERT_TRUE(viewer.Read());
  const auto get = [&](const std::string& host) {
    return TlsRequest(gateway.port(),
                      "GET /healthz HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n");
  };
  EXPECT_TRUE(get("other.example").starts_with("HTTP/1.1 403"));
  ASSERT_TRUE(MakeSelfSignedCertificate(folder_ / "new", {"other.example"}));
  for (const char* file : {"key.pem", "certificate.pem"})
    fs::rename(folder_ / "new" / file, folder_ / "tls" / file);
  EXPECT_TRUE(Eventually([&] { return get("other.example").starts_with("HTTP/1.1 200"); }));
  EXPECT_TRUE(get("studio.example").starts_with("HTTP/1.1 403"));
  EXPECT_TRUE(viewer.SendText(R"({"type":"ping","viewer_us":1})"));
  EXPECT_TRUE(viewer.ReadText("pong"));
}

TEST_F(GatewayLogin, BeyondLoopbackIsOpenedWithTokensAndTlsOnly) {
  GatewayConfig config = Tls();
  config.listen = "0.0.0.0:0";
  Gateway open(config);
  ASSERT_TRUE(open.Start());
  EXPECT_EQ(open.url(), "https://localhost:" + std::to_string(open.port()) + "/");
  config.token_file.clear();
  EXPECT_FALSE(Gateway(config).Start());
  config = Plain();
  config.listen = "0.0.0.0:0";
  EXPECT_FALSE(Gateway(config).Start());
}

}  // namespace
}  // namespace mixstage
