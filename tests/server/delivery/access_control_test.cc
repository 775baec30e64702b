// SPDX-License-Identifier: Apache-2.0
//
// Tickets, attempts, certificates and the audit log, each alone; the gateway's tests hold them together.
#include "server/delivery/access_control.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "server/delivery/tls_certificate.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;
using boost::asio::ip::make_address;

constexpr std::int64_t kSecondUs = 1'000'000;

std::string ReadAll(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

class AccessFiles : public testing::Test {
 protected:
  AccessFiles() : folder_(fs::temp_directory_path() / ("mixstage_access_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~AccessFiles() override { fs::remove_all(folder_); }

  const fs::path folder_;
};

TEST(TicketDesk, ATicketServesOnceWithinItsTime) {
  TicketDesk desk;
  const ViewerIdentity anna{.name = "anna", .role = WatchRole::kDirector};
  const auto once = desk.Issue(anna, 0), late = desk.Issue(anna, 0), punctual = desk.Issue(anna, 0);
  ASSERT_TRUE(once && late && punctual);
  EXPECT_EQ(desk.Redeem(*once, 1), anna);
  EXPECT_FALSE(desk.Redeem(*once, 2)) << "once";
  EXPECT_FALSE(desk.Redeem("", 2));
  EXPECT_FALSE(desk.Redeem(std::string(43, 'A'), 2));
  EXPECT_TRUE(desk.Redeem(*punctual, TicketDesk::kLifeUs - 1));
  EXPECT_FALSE(desk.Redeem(*late, TicketDesk::kLifeUs));
}

TEST(TicketDesk, OneWhoAsksOnAndOnTakesFromHimselfAlone) {
  TicketDesk desk;
  const auto bens = desk.Issue({.name = "ben"}, 0);
  const auto first = desk.Issue({.name = "anna"}, 0);
  std::string newest;
  for (int i = 0; i < 5000; ++i) newest = desk.Issue({.name = "anna"}, 1).value();
  EXPECT_FALSE(desk.Redeem(*first, 2));
  EXPECT_TRUE(desk.Redeem(newest, 2));
  EXPECT_TRUE(desk.Redeem(*bens, 2));
}

TEST(TicketDesk, IsBoundedAndEmptiesItself) {
  TicketDesk desk;
  for (std::size_t i = 0; i < TicketDesk::kMaxTickets; ++i)
    ASSERT_TRUE(desk.Issue({.name = std::to_string(i)}, 0));
  EXPECT_FALSE(desk.Issue({.name = "one more"}, 1));
  EXPECT_TRUE(desk.Issue({.name = "one more"}, TicketDesk::kLifeUs));
}

TEST(TicketDesk, ARevokedOwnersTicketsEnd) {
  TicketDesk desk;
  const auto anna = desk.Issue({.name = "anna"}, 0), ben = desk.Issue({.name = "ben"}, 0);
  desk.Keep([](const ViewerIdentity& identity) { return identity.name == "ben"; });
  EXPECT_FALSE(desk.Redeem(*anna, 1));
  EXPECT_TRUE(desk.Redeem(*ben, 1));
}

TEST(AttemptLimits, EachAddressHasItsOwn) {
  AttemptLimits limits;
  const auto a = make_address("192.0.2.1"), b = make_address("192.0.2.2");
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(limits.Take(a, kSecondUs)) << i;
  EXPECT_FALSE(limits.Take(a, kSecondUs));
  EXPECT_TRUE(limits.Take(b, kSecondUs));
  int taken = 0;
  for (int i = 1; i <= 100; ++i) taken += limits.Take(a, kSecondUs + i * 100'000) ? 1 : 0;
  EXPECT_NEAR(taken, 50, 1) << "five a second";
}

TEST(AttemptLimits, AnIpv6NetworkIsOneAndAMappedAddressIsIpv4) {
  AttemptLimits limits;
  for (int i = 0; i < 10; ++i)
    EXPECT_TRUE(limits.Take(make_address("2001:db8::" + std::to_string(i + 1)), kSecondUs));
  EXPECT_FALSE(limits.Take(make_address("2001:db8::ffff"), kSecondUs));
  EXPECT_TRUE(limits.Take(make_address("2001:db8:0:1::1"), kSecondUs));
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(limits.Take(make_address("192.0.2.1"), kSecondUs));
  EXPECT_FALSE(limits.Take(make_address("::ffff:192.0.2.1"), kSecondUs));
}

TEST(AttemptLimits, AFloodOfAddressesIsBoundedAndForgotten) {
  AttemptLimits limits;
  int taken = 0;
  for (unsigned i = 0; i < 5000; ++i)
    taken += limits.Take(boost::asio::ip::make_address_v4(0x0A000000u + i), kSecondUs) ? 1 : 0;
  EXPECT_EQ(taken, static_cast<int>(AttemptLimits::kMaxAddresses) + 10) << "the rest share one limit";
  EXPECT_TRUE(limits.Take(make_address("192.0.2.1"), 4 * kSecondUs)) << "the quiet ones make room";
}

TEST_F(AccessFiles, ASelfSignedCertificateLoadsAndNamesItsHosts) {
  ASSERT_TRUE(
      MakeSelfSignedCertificate(folder_ / "tls", {"Studio.example", "*.cast.example", "192.0.2.7", "::1"}));
  const TlsFiles files{folder_ / "tls/certificate.pem", folder_ / "tls/key.pem"};
  const auto loaded = LoadTlsCertificate(files);
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->names,
            (std::vector<std::string>{"studio.example", "*.cast.example", "192.0.2.7", "::1"}));
  struct stat about {};
  ASSERT_EQ(stat(files.key.c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600u);
  EXPECT_FALSE(MakeSelfSignedCertificate(folder_ / "tls", {"localhost"}))
      << "a key that is there is not replaced";
}

TEST_F(AccessFiles, HostsThatAreNoneAreRefused) {
  for (const std::string& host :
       {std::string(), std::string("a b"), std::string("a,DNS:b"), std::string(".a"), std::string("a..b"),
        std::string("a\nb"), std::string("*"), std::string(254, 'a')}) {
    EXPECT_FALSE(MakeSelfSignedCertificate(folder_ / "tls", {host})) << host;
  }
  EXPECT_FALSE(MakeSelfSignedCertificate(folder_ / "tls", {}));
  EXPECT_FALSE(fs::exists(folder_ / "tls"));
}

TEST_F(AccessFiles, CertificatesThatCannotServeAreRefusedByFile) {
  ASSERT_TRUE(MakeSelfSignedCertificate(folder_ / "a", {"localhost"}));
  ASSERT_TRUE(MakeSelfSignedCertificate(folder_ / "b", {"localhost"}));
  std::ofstream(folder_ / "rubbish.pem")
      << "-----BEGIN CERTIFICATE-----\nrubbish\n-----END CERTIFICATE-----\n";
  chmod((folder_ / "rubbish.pem").c_str(), 0600);
  const fs::path certificate = folder_ / "a/certificate.pem", key = folder_ / "a/key.pem";
  const std::pair<TlsFiles, std::string> cases[] = {
      {{certificate, {}}, "both"},
      {{certificate, folder_ / "nowhere.pem"}, "nowhere.pem"},
      {{folder_ / "nowhere.pem", key}, "nowhere.pem"},
      {{folder_ / "rubbish.pem", key}, "rubbish.pem"},
      {{certificate, folder_ / "rubbish.pem"}, "rubbish.pem"},
      {{certificate, folder_ / "b/key.pem"}, "not the one of"},
  };
  for (const auto& [files, word] : cases) {
    const auto loaded = LoadTlsCertificate(files);
    ASSERT_FALSE(loaded) << word;
    EXPECT_EQ(loaded.error().code, ErrorCode::kInvalidConfig);
    EXPECT_NE(loaded.error().message.find(word), std::string::npos) << loaded.error().message;
  }
  chmod(key.c_str(), 0644);
  EXPECT_NE(LoadTlsCertificate({certificate, key}).error().message.find("chmod 600"), std::string::npos);
}

TEST_F(AccessFiles, AuditLinesAreJsonWhateverIsHandedIn) {
  AuditLog log(folder_ / "audit.jsonl");
  ASSERT_TRUE(log.Check());
  log.Audit("anna", WatchRole::kDirector, "192.0.2.1", "login");
  log.Audit("anna", WatchRole::kDirector, "192.0.2.1", "edit", "{\"type\": \"edit\",\n \"op\": \"undo\"}");
  log.Audit("a\nb\"\xff", WatchRole::kViewer, "", "edit", "{no json\n");
  log.Audit("anna", WatchRole::kDirector, "", "edit", "{\"x\": \"" + std::string(9000, 'x') + "\"}");
  log.Audit("anna", WatchRole::kDirector, "", "edit", std::string(5000, '['));
  log.AuditRefusedLogin("192.0.2.9", "token");
  std::istringstream lines(ReadAll(folder_ / "audit.jsonl"));
  std::vector<nlohmann::json> read;
  for (std::string line; std::getline(lines, line);) {
    EXPECT_LE(line.size(), AuditLog::kMaxLineBytes);
    read.push_back(nlohmann::json::parse(line));
  }
  ASSERT_EQ(read.size(), 6u);
  EXPECT_EQ(read[0]["name"], "anna");
  EXPECT_EQ(read[0]["role"], "director");
  EXPECT_EQ(read[0]["action"], "login");
  EXPECT_EQ(read[0]["time"].get<std::string>().size(), 24u);
  EXPECT_FALSE(read[0].contains("edit"));
  EXPECT_EQ(read[1]["edit"]["op"], "undo");
  for (const int i : {2, 3, 4}) EXPECT_TRUE(read[static_cast<std::size_t>(i)]["edit"].is_null()) << i;
  EXPECT_EQ(read[5]["action"], "login_refused");
}

TEST_F(AccessFiles, AFloodOfRefusedLoginsDoesNotFillTheDisk) {
  AuditLog log(folder_ / "audit.jsonl");
  for (int i = 0; i < 10'000; ++i) log.AuditRefusedLogin("192.0.2.9", "token");
  EXPECT_LT(fs::file_size(folder_ / "audit.jsonl"), 1'000'000u);
}

TEST_F(AccessFiles, AnAuditLogThatWasMovedAwayBeginsAnew) {
  AuditLog log(folder_ / "audit.jsonl");
  log.Audit("anna", WatchRole::kDirector, "", "login");
  fs::rename(folder_ / "audit.jsonl", folder_ / "audit.1");
  log.Audit("ben", WatchRole::kViewer, "", "login");
  EXPECT_NE(ReadAll(folder_ / "audit.jsonl").find("ben"), std::string::npos);
  EXPECT_FALSE(AuditLog(folder_ / "nowhere/audit.jsonl").Check());
}

TEST_F(AccessFiles, TokensAreReadAgainWhenTheyChangeAndKeptWhenTheyBreak) {
  const GatewayConfig config{.token_file = folder_ / "tokens.json"};
  const auto anna = MakeToken(config.token_file, "anna", WatchRole::kViewer);
  AccessControl access(config);
  ASSERT_TRUE(access.Open({"127.0.0.1", 0, true}));
  EXPECT_TRUE(access.login_needed());
  const auto from = make_address("192.0.2.1");
  const auto login = access.LogIn("Bearer " + *anna, from, kSecondUs);
  ASSERT_EQ(login.outcome, AccessControl::LoginOutcome::kAdmitted);
  EXPECT_FALSE(access.Refresh(2 * kSecondUs)) << "nothing changed";

  const std::string good = ReadAll(config.token_file);
  std::ofstream(config.token_file) << "{ broken";
  EXPECT_FALSE(access.Refresh(4 * kSecondUs));
  EXPECT_TRUE(access.MayStay(login.identity));

  std::ofstream(config.token_file) << good;
  ASSERT_TRUE(RevokeToken(config.token_file, "anna"));
  EXPECT_TRUE(access.Refresh(6 * kSecondUs));
  EXPECT_FALSE(access.MayStay(login.identity));
  EXPECT_FALSE(access.Redeem(login.ticket, 6 * kSecondUs)) << "a ticket ends with its token";
}

TEST_F(AccessFiles, BearersAreTakenInOneFormOnly) {
  const GatewayConfig config{.token_file = folder_ / "tokens.json"};
  const auto anna = MakeToken(config.token_file, "anna", WatchRole::kViewer);
  AccessControl access(config);
  ASSERT_TRUE(access.Open({"127.0.0.1", 0, true}));
  std::int64_t now_us = 0;
  const auto outcome = [&](const std::string& authorization) {
    return access.LogIn(authorization, make_address("192.0.2.1"), now_us += kSecondUs).outcome;
  };
  EXPECT_EQ(outcome("Bearer " + *anna), AccessControl::LoginOutcome::kAdmitted);
  EXPECT_EQ(outcome("bearer " + *anna), AccessControl::LoginOutcome::kAdmitted);
  for (const std::string& bad :
       {std::string(), *anna, "Basic " + *anna, "Bearer  " + *anna, "Bearer " + *anna + " ",
        "Bearer " + anna->substr(1), "Bearer " + std::string(43, 'A'), std::string("Bearer")}) {
    EXPECT_EQ(outcome(bad), AccessControl::LoginOutcome::kRefused) << bad.substr(0, 8);
  }
}

TEST_F(AccessFiles, ForeignNamesAndOriginsAreNotItsOwn) {
  ASSERT_TRUE(MakeSelfSignedCertificate(folder_ / "tls", {"studio.example"}));
  const GatewayConfig config{.tls = {folder_ / "tls/certificate.pem", folder_ / "tls/key.pem"},
                             .origins = {"https://elsewhere.example"},
                             .hosts = {"further.example"}};
  AccessControl access(config);
  ASSERT_TRUE(access.Open({"127.0.0.1", 0, true}));
  for (const char* host : {"localhost:8443", "127.0.0.1", "studio.example:8443", "further.example"})
    EXPECT_TRUE(access.IsOwnHost(host)) << host;
  for (const char* host : {"", "evil.example", "elsewhere.example", "192.0.2.1"})
    EXPECT_FALSE(access.IsOwnHost(host)) << host;
  EXPECT_TRUE(access.MayConnect("https://studio.example:8443", "studio.example:8443"));
  EXPECT_TRUE(access.MayConnect("https://elsewhere.example", "studio.example:8443"));
  for (const char* origin : {"http://studio.example:8443", "https://studio.example",
                             "https://further.example", "https://elsewhere.example:1", "null", ""})
    EXPECT_FALSE(access.MayConnect(origin, "studio.example:8443")) << origin;
  const GatewayConfig star{.origins = {"*"}};
  EXPECT_FALSE(AccessControl(star).Open({"127.0.0.1", 0, true}));
}

}  // namespace
}  // namespace mixstage
