// SPDX-License-Identifier: Apache-2.0
//
// The gateway's HTTP side over real sockets.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "server/delivery/gateway.h"
#include "server/delivery/page_files.h"
#include "tests/server/delivery/test_viewer.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

class GatewayHttp : public testing::Test {
 protected:
  GatewayHttp() : folder_(fs::temp_directory_path() / ("mixstage_page_" + std::to_string(getpid()))) {
    fs::create_directories(folder_ / "page" / "assets");
    Write("secret.txt", "secret");
    Write("page/index.html", "<!doctype html><title>MixStage</title>");
    Write("page/assets/app-1234.js", "export {};");
    fs::create_symlink(folder_ / "secret.txt", folder_ / "page" / "link.txt");
  }
  ~GatewayHttp() override { fs::remove_all(folder_); }

  void Write(const std::string& name, const std::string& content) {
    std::ofstream(folder_ / name, std::ios::binary) << content;
  }
  GatewayConfig Config() const { return {.listen = "127.0.0.1:0", .page_folder = folder_ / "page"}; }

  const fs::path folder_;
};

TEST_F(GatewayHttp, ServesThePageWithItsTypesAndGuards) {
  Gateway gateway(Config());
  ASSERT_TRUE(gateway.Start());
  for (const char* target : {"/", "/index.html", "/?view=depth"}) {
    const std::string page = HttpGet(gateway.port(), target);
    EXPECT_NE(page.find("200 OK"), std::string::npos) << page;
    EXPECT_NE(page.find("<title>MixStage</title>"), std::string::npos);
    EXPECT_NE(page.find("Content-Type: text/html; charset=utf-8\r\n"), std::string::npos);
    EXPECT_NE(page.find("Cache-Control: no-store\r\n"), std::string::npos);
    EXPECT_NE(page.find("Content-Security-Policy: default-src 'self';"), std::string::npos);
    for (const char* directive :
         {"script-src 'self' 'wasm-unsafe-eval'", "img-src 'self' data:", "connect-src 'self'",
          "worker-src 'self'", "style-src 'self'", "object-src 'none'", "base-uri 'none'",
          "form-action 'self'", "frame-ancestors 'none'"})
      EXPECT_NE(page.find(directive), std::string::npos) << directive;
    EXPECT_NE(page.find("X-Content-Type-Options: nosniff\r\n"), std::string::npos);
    EXPECT_NE(page.find("Referrer-Policy: no-referrer\r\n"), std::string::npos);
    EXPECT_NE(page.find("X-Frame-Options: DENY\r\n"), std::string::npos);
    EXPECT_NE(page.find("Cross-Origin-Opener-Policy: same-origin\r\n"), std::string::npos);
    EXPECT_NE(page.find("Cross-Origin-Resource-Policy: same-origin\r\n"), std::string::npos);
    EXPECT_EQ(page.find("Strict-Transport-Security"), std::string::npos)
        << "only what came by TLS may say so";
  }
  const std::string script = HttpGet(gateway.port(), "/assets/app-1234.js");
  EXPECT_NE(script.find("Content-Type: text/javascript; charset=utf-8\r\n"), std::string::npos);
  EXPECT_NE(script.find("immutable"), std::string::npos);
  EXPECT_NE(script.find("export {};"), std::string::npos);
}

TEST_F(GatewayHttp, NoPathLeadsOutOfTheFolder) {
  Gateway gateway(Config());
  ASSERT_TRUE(gateway.Start());
  for (const char* target : {"/../secret.txt", "/assets/../../secret.txt", "/%2e%2e/secret.txt",
                             "/..%2fsecret.txt", "//secret.txt", "/link.txt", "/assets", "/assets/",
                             "/./index.html", "../secret.txt", "/assets\\..\\..\\secret.txt"}) {
    const std::string response = HttpGet(gateway.port(), target);
    EXPECT_EQ(response.find("secret\n"), std::string::npos);
    EXPECT_TRUE(response.starts_with("HTTP/1.1 404") || response.starts_with("HTTP/1.1 400"))
        << target << response;
  }
}

TEST_F(GatewayHttp, HeadSendsNoBodyAndOtherMethodsAreRefused) {
  Gateway gateway(Config());
  ASSERT_TRUE(gateway.Start());
  const std::string rest = " / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
  const std::string head = RawRequest(gateway.port(), "HEAD" + rest);
  EXPECT_TRUE(head.starts_with("HTTP/1.1 200"));
  EXPECT_EQ(head.find("<title>"), std::string::npos);
  EXPECT_TRUE(RawRequest(gateway.port(), "DELETE" + rest).starts_with("HTTP/1.1 405"));
}

TEST_F(GatewayHttp, HealthSaysTheStateOfTheNewestStats) {
  Gateway gateway(Config());
  ASSERT_TRUE(gateway.Start());
  EXPECT_NE(HttpGet(gateway.port(), "/healthz").find(R"({"status":"starting","state":"","login":false})"),
            std::string::npos);
  const auto says = [&](const std::string& state, const std::string& body) {
    gateway.PublishStats(ToJson(WatchStats{.state = state}));
    return Eventually([&] { return HttpGet(gateway.port(), "/healthz").find(body) != std::string::npos; });
  };
  EXPECT_TRUE(says("live", R"({"status":"ok","state":"live","login":false})"));
  EXPECT_TRUE(says("no_agent", R"({"status":"degraded","state":"no_agent","login":false})"));
}

TEST_F(GatewayHttp, MetricsComeFromTheCallback) {
  Gateway gateway(Config(), [] { return std::string("mixstage_frames_total 7\n"); });
  ASSERT_TRUE(gateway.Start());
  EXPECT_NE(HttpGet(gateway.port(), "/metrics").find("\r\n\r\nmixstage_frames_total 7\n"), std::string::npos);
}

TEST_F(GatewayHttp, ForeignHostsOversizedHeadersAndRubbishAreRefused) {
  Gateway gateway(Config());
  ASSERT_TRUE(gateway.Start());
  const auto get = [&](const std::string& headers) {
    return RawRequest(gateway.port(), "GET / HTTP/1.1\r\nConnection: close\r\n" + headers + "\r\n");
  };
  EXPECT_TRUE(get("Host: evil.example\r\n").starts_with("HTTP/1.1 403"));
  EXPECT_TRUE(get("").starts_with("HTTP/1.1 403"));
  EXPECT_FALSE(get("Host: localhost\r\nX: " + std::string(20'000, 'x') + "\r\n").starts_with("HTTP/1.1 200"));
  EXPECT_FALSE(get("Host: localhost\r\nContent-Length: 5\r\n\r\nhello").starts_with("HTTP/1.1 200"));
  EXPECT_FALSE(RawRequest(gateway.port(), std::string(5000, '\x03')).starts_with("HTTP/1.1 200"));
  EXPECT_TRUE(HttpGet(gateway.port(), "/").starts_with("HTTP/1.1 200")) << "and all others are still served";
}

TEST_F(GatewayHttp, SilentConnectionsAreClosedAndTheirNumberIsBounded) {
  GatewayConfig config = Config();
  config.request_timeout_s = 1;
  config.max_connections = 4;
  config.max_viewers = 4;
  Gateway gateway(config);
  ASSERT_TRUE(gateway.Start());
  boost::asio::io_context io;
  std::vector<boost::asio::ip::tcp::socket> silent;
  for (int i = 0; i < 12; ++i) {
    silent.emplace_back(io);
    silent.back().connect({boost::asio::ip::make_address("127.0.0.1"), gateway.port()});
  }
  EXPECT_TRUE(Eventually([&] { return gateway.counters().refused_full >= 8; }));
  EXPECT_LE(gateway.counters().connections, 4u);
  EXPECT_TRUE(Eventually([&] { return gateway.counters().connections == 0; }));
  EXPECT_TRUE(HttpGet(gateway.port(), "/").starts_with("HTTP/1.1 200"));
}

TEST_F(GatewayHttp, WatchIsAWebSocketOnly) {
  Gateway gateway(Config());
  ASSERT_TRUE(gateway.Start());
  EXPECT_TRUE(HttpGet(gateway.port(), "/watch").starts_with("HTTP/1.1 426"));
}

TEST_F(GatewayHttp, APortInUseIsSaidSo) {
  Gateway first(Config());
  ASSERT_TRUE(first.Start());
  GatewayConfig config = Config();
  config.listen = "127.0.0.1:" + std::to_string(first.port());
  Gateway second(config);
  const Status started = second.Start();
  ASSERT_FALSE(started);
  EXPECT_EQ(started.error().code, ErrorCode::kUnavailable);
  EXPECT_NE(started.error().message.find("port is in use"), std::string::npos) << started.error().message;
}

TEST_F(GatewayHttp, BeyondLoopbackNothingIsOpenedWithoutLoginAndTls) {
  GatewayConfig config = Config();
  config.listen = "0.0.0.0:0";
  Gateway gateway(config);
  const Status started = gateway.Start();
  ASSERT_FALSE(started);
  EXPECT_EQ(started.error().code, ErrorCode::kInvalidConfig);
  for (const char* fix :
       {"login", "token make --file", "certificate --out", "--tokens", "--tls-certificate"}) {
    EXPECT_NE(started.error().message.find(fix), std::string::npos) << started.error().message;
  }
}

TEST_F(GatewayHttp, AFolderThatIsNoPageIsRefused) {
  EXPECT_FALSE(PageFiles::Load(folder_ / "nowhere"));
  EXPECT_FALSE(PageFiles::Load(folder_));  // no index.html
  const auto pages = PageFiles::Load(folder_ / "page");
  ASSERT_TRUE(pages);
  EXPECT_EQ(pages->Find("/link.txt"), nullptr) << "links are not followed";
}

}  // namespace
}  // namespace mixstage
