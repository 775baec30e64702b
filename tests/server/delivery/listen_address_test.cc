// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/listen_address.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace mixstage {
namespace {

TEST(ListenAddress, SaysWhetherOtherMachinesReachIt) {
  for (const auto& [text, ip] :
       {std::pair{"127.0.0.1:8090", "127.0.0.1"}, std::pair{"127.1.2.3:8090", "127.1.2.3"},
        std::pair{"localhost:8090", "127.0.0.1"}, std::pair{"LocalHost:8090", "127.0.0.1"},
        std::pair{"[::1]:8090", "::1"}}) {
    const auto address = ParseListenAddress(text);
    ASSERT_TRUE(address) << address.error().message;
    EXPECT_EQ(address->ip, ip);
    EXPECT_EQ(address->port, 8090);
    EXPECT_TRUE(address->loopback);
  }
  EXPECT_EQ(ParseListenAddress("127.0.0.1:0")->port, 0);
}

TEST(ListenAddress, BeyondLoopbackIsSaidSo) {
  for (const char* text : {"0.0.0.0:8090", "[::]:8090", "192.168.1.5:8090", "128.0.0.1:80"}) {
    const auto address = ParseListenAddress(text);
    ASSERT_TRUE(address) << text;
    EXPECT_FALSE(address->loopback) << text;
  }
}

TEST(ListenAddress, BadFormsAreRefused) {
  for (const char* text :
       {"", ":", "8090", "127.0.0.1", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:65536", "127.0.0.1:-1",
        "127.0.0.1:80x", "[::1", "[::1]8090", ":8090", "example.org:8090"}) {
    EXPECT_FALSE(ParseListenAddress(text)) << text;
  }
}

TEST(LoopbackHost, NamesOfThisMachineOnly) {
  for (const char* host :
       {"localhost", "localhost:8090", "127.0.0.1:1", "[::1]:8090", "[::1]", "LOCALHOST:80"}) {
    EXPECT_TRUE(IsLoopbackHost(host)) << host;
  }
  for (const char* host : {"", "evil.example", "localhost.evil.example", "127.0.0.1.evil.example:80",
                           "10.0.0.1", "[::2]:80", "[::1]x", "xlocalhost", "0.0.0.0:80"}) {
    EXPECT_FALSE(IsLoopbackHost(host)) << host;
  }
}

TEST(HostAmong, NamesMatchWholeAndAStarStandsForOneLabel) {
  const std::vector<std::string> names = {"studio.example", "*.cast.example", "192.0.2.7", "2001:db8::1"};
  for (const char* host : {"studio.example", "STUDIO.example:8443", "a.cast.example", "192.0.2.7:443",
                           "[2001:db8::1]:8443", "[2001:db8::1]"}) {
    EXPECT_TRUE(IsHostAmong(host, names)) << host;
  }
  for (const char* host : {"", "studio.example.evil", "xstudio.example", "cast.example", "a.b.cast.example",
                           ".cast.example", "*.cast.example.evil", "192.0.2.70", "localhost"}) {
    EXPECT_FALSE(IsHostAmong(host, names)) << host;
  }
}

TEST(Origin, IsSchemeAndHostWithoutAPath) {
  for (const char* origin :
       {"https://studio.example", "http://localhost:5173", "https://[2001:db8::1]:8443"}) {
    EXPECT_TRUE(IsOrigin(origin)) << origin;
  }
  for (const char* origin : {"", "*", "null", "studio.example", "https://", "https://studio.example/",
                             "https://Studio.example", "https://*.example", "ftp://studio.example"}) {
    EXPECT_FALSE(IsOrigin(origin)) << origin;
  }
}

TEST(OwnOrigin, IsTheHostsPageAndNoOther) {
  EXPECT_TRUE(IsOwnOrigin("http://localhost:8090", "http://", "localhost:8090"));
  EXPECT_TRUE(IsOwnOrigin("http://LOCALHOST:8090", "http://", "localhost:8090"));
  EXPECT_TRUE(IsOwnOrigin("https://studio.example", "https://", "studio.example"));
  EXPECT_FALSE(IsOwnOrigin("http://studio.example", "https://", "studio.example"));
  for (const char* origin :
       {"", "null", "http://localhost:8091", "https://localhost:8090", "http://127.0.0.1:8090",
        "http://localhost:8090/", "http://localhost:8090.evil.example", "http://localhost"}) {
    EXPECT_FALSE(IsOwnOrigin(origin, "http://", "localhost:8090")) << origin;
  }
}

}  // namespace
}  // namespace mixstage
