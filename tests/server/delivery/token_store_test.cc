// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/token_store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

namespace mixstage {
namespace {

namespace fs = std::filesystem;

class TokenStoreFile : public testing::Test {
 protected:
  TokenStoreFile() : folder_(fs::temp_directory_path() / ("mixstage_tokens_" + std::to_string(getpid()))) {
    fs::create_directories(folder_);
  }
  ~TokenStoreFile() override { fs::remove_all(folder_); }

  std::string Content() const {
    std::ostringstream text;
    text << std::ifstream(file_).rdbuf();
    return text.str();
  }
  void Write(const std::string& text) const {
    std::ofstream(file_) << text;
    chmod(file_.c_str(), 0600);
  }

  const fs::path folder_;
  const fs::path file_ = folder_ / "tokens.json";
};

TEST(Secret, IsThatOfTheStandard) {
  EXPECT_EQ(ToHex(DigestOf("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(FromHex(ToHex(DigestOf("abc"))), DigestOf("abc"));
  for (const char* hex : {"", "ba78", "zz7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"}) {
    EXPECT_FALSE(FromHex(hex)) << hex;
  }
}

TEST(Secret, Has256BitsAndNoTwoAreTheSame) {
  std::set<std::string> secrets;
  std::set<char> last;
  for (int i = 0; i < 500; ++i) {
    const auto secret = MakeSecret();
    ASSERT_TRUE(secret);
    EXPECT_TRUE(IsSecret(*secret)) << *secret;
    secrets.insert(*secret);
    last.insert(secret->back());
  }
  EXPECT_EQ(secrets.size(), 500u);
  EXPECT_EQ(last.size(), 16u) << "the 43rd character carries the last four bits";
  EXPECT_FALSE(IsSecret(std::string(42, 'A')));
  EXPECT_FALSE(IsSecret(std::string(42, 'A') + "="));
}

TEST(FindDigest, FindsEachPlaceAndNothingElse) {
  std::vector<Sha256> digests;
  for (int i = 0; i < 20; ++i) digests.push_back(DigestOf(std::to_string(i)));
  for (std::size_t i = 0; i < digests.size(); ++i) {
    EXPECT_EQ(FindDigest(digests, digests[i]), i);
    for (std::size_t byte = 0; byte < 32; ++byte) {
      Sha256 near = digests[i];
      near[byte] ^= 1;
      EXPECT_FALSE(FindDigest(digests, near));
    }
  }
  EXPECT_FALSE(FindDigest({}, digests[0]));
}

TEST_F(TokenStoreFile, AMadeTokenIsFoundAndNeverStored) {
  const auto anna = MakeToken(file_, "anna", WatchRole::kDirector);
  const auto ben = MakeToken(file_, "ben@home", WatchRole::kViewer);
  ASSERT_TRUE(anna && ben) << anna.error().message;
  struct stat about {};
  ASSERT_EQ(stat(file_.c_str(), &about), 0);
  EXPECT_EQ(about.st_mode & 0777, 0600u);
  EXPECT_EQ(Content().find(*anna), std::string::npos);

  const auto store = TokenStore::Load(file_);
  ASSERT_TRUE(store) << store.error().message;
  const auto found = store->Find(*anna);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->name, "anna");
  EXPECT_EQ(found->role, WatchRole::kDirector);
  EXPECT_EQ(store->Find(*ben)->role, WatchRole::kViewer);
  EXPECT_TRUE(store->Holds(*found));
  EXPECT_FALSE(store->Find(""));
  EXPECT_FALSE(store->Find(std::string(43, 'A')));
  EXPECT_FALSE(store->Find(ToHex(found->token_sha256))) << "the digest is no token";

  const auto json = nlohmann::json::parse(Content());
  EXPECT_EQ(json["version"], 1);
  EXPECT_EQ(json["tokens"][0]["sha256"], ToHex(DigestOf(*anna)));
  EXPECT_EQ(json["tokens"][0]["created"].get<std::string>().size(), 20u);
}

TEST_F(TokenStoreFile, ARevokedTokenIsGoneAndItsOwnerMayNotStay) {
  const auto anna = MakeToken(file_, "anna", WatchRole::kDirector);
  const auto identity = TokenStore::Load(file_)->Find(*anna);
  EXPECT_FALSE(MakeToken(file_, "anna", WatchRole::kViewer)) << "one token a name";
  ASSERT_TRUE(RevokeToken(file_, "anna"));
  EXPECT_FALSE(RevokeToken(file_, "anna"));
  ASSERT_TRUE(MakeToken(file_, "anna", WatchRole::kDirector));
  const auto store = TokenStore::Load(file_);
  EXPECT_FALSE(store->Find(*anna));
  EXPECT_FALSE(store->Holds(*identity)) << "the same name by another token is another login";
}

TEST_F(TokenStoreFile, EditingAtTheSameTimeLosesNothing) {
  std::vector<std::jthread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 10; ++i)
        EXPECT_TRUE(MakeToken(file_, std::to_string(t) + "-" + std::to_string(i), WatchRole::kViewer));
    });
  }
  threads.clear();
  EXPECT_EQ(TokenStore::Load(file_)->tokens().size(), 40u);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1)
      << "nothing is left behind";
}

TEST_F(TokenStoreFile, ALeftOverOfACrashIsReplaced) {
  std::ofstream(file_.string() + ".new") << "half a fi";
  ASSERT_TRUE(MakeToken(file_, "anna", WatchRole::kViewer));
  EXPECT_EQ(TokenStore::Load(file_)->tokens().size(), 1u);
}

TEST_F(TokenStoreFile, OpenToOthersIsRefusedWithTheFix) {
  ASSERT_TRUE(MakeToken(file_, "anna", WatchRole::kViewer));
  for (const mode_t mode : {0644u, 0640u, 0604u, 0660u}) {
    chmod(file_.c_str(), mode);
    const auto store = TokenStore::Load(file_);
    ASSERT_FALSE(store) << mode;
    EXPECT_NE(store.error().message.find("chmod 600"), std::string::npos) << store.error().message;
  }
}

TEST_F(TokenStoreFile, WhatIsNoTokenFileIsRefusedByName) {
  const std::string digest(64, 'a');
  const std::string good = R"({"name": "a", "role": "viewer", "sha256": ")" + digest + R"("})";
  for (const std::string& text :
       {std::string(), std::string("{"), std::string("[]"), std::string(R"({"version": 2, "tokens": []})"),
        std::string(R"({"version": 1})"), std::string(R"({"version": 1, "tokens": [7]})"),
        R"({"version": 1, "tokens": [)" + good + "," + good + "]}",
        R"({"version": 1, "tokens": [{"name": "a b", "role": "viewer", "sha256": ")" + digest + R"("}]})",
        R"({"version": 1, "tokens": [{"name": "a", "role": "king", "sha256": ")" + digest + R"("}]})",
        std::string(R"({"version": 1, "tokens": [{"name": "a", "role": "viewer", "sha256": "aa"}]})"),
        std::string(100'000, '['), std::string((1 << 20) + 1, ' ')}) {
    Write(text);
    const auto store = TokenStore::Load(file_);
    ASSERT_FALSE(store) << text.substr(0, 80);
    EXPECT_EQ(store.error().code, ErrorCode::kInvalidConfig);
    EXPECT_TRUE(store.error().message.starts_with(file_.string())) << store.error().message;
  }
  Write(R"({"version": 1, "tokens": [)" + good + "]}");
  EXPECT_TRUE(TokenStore::Load(file_));
  EXPECT_FALSE(TokenStore::Load(folder_));
  EXPECT_FALSE(TokenStore::Load(folder_ / "nowhere"));
}

TEST_F(TokenStoreFile, NamesThatWouldBreakALineAreRefused) {
  for (const std::string& name : {std::string(), std::string("a b"), std::string("a\"b"), std::string("a\nb"),
                                  std::string("\xc3\xa4"), std::string(65, 'a')}) {
    EXPECT_FALSE(MakeToken(file_, name, WatchRole::kViewer)) << name;
  }
  EXPECT_FALSE(fs::exists(file_));
}

}  // namespace
}  // namespace mixstage
