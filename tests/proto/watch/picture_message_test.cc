// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/picture_message.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <string>

namespace mixstage {
namespace {

std::vector<std::uint8_t> FromHex(const std::string& hex) {
  std::vector<std::uint8_t> bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoul(hex.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

nlohmann::json Vectors() {
  std::ifstream file(MIXSTAGE_SOURCE_DIR "/tests/vectors/watch.json");
  return nlohmann::json::parse(file);
}

TEST(PictureMessage, ReadsTheSharedVectorsAsTheyAreMeant) {
  const nlohmann::json vectors = Vectors();
  ASSERT_GE(vectors.size(), 7u);
  for (const auto& vector : vectors) {
    SCOPED_TRACE(vector["name"].get<std::string>());
    const std::vector<std::uint8_t> bytes = FromHex(vector["hex"]);
    const auto picture = ReadWatchPicture(bytes);
    ASSERT_EQ(picture.has_value(), vector["ok"].get<bool>());
    if (!picture) {
      EXPECT_EQ(RefusalName(picture.error()), vector["reason"].get<std::string>());
      continue;
    }
    const auto& fields = vector["fields"];
    EXPECT_EQ(static_cast<int>(picture->header.stream), fields["stream"].get<int>());
    EXPECT_EQ(picture->header.key_frame, fields["key"].get<bool>());
    EXPECT_EQ(std::to_string(picture->header.frame), fields["frame"].get<std::string>());
    EXPECT_EQ(std::to_string(picture->header.capture_us), fields["capture_us"].get<std::string>());
    EXPECT_EQ(std::to_string(picture->header.encoded_us), fields["encoded_us"].get<std::string>());
    EXPECT_EQ(picture->header.near_m, static_cast<float>(fields["near_m"].get<double>()));
    EXPECT_EQ(picture->header.far_m, static_cast<float>(fields["far_m"].get<double>()));
    const std::vector<std::uint8_t> payload = FromHex(fields["payload_hex"]);
    EXPECT_EQ(std::vector<std::uint8_t>(picture->payload.begin(), picture->payload.end()), payload);
    EXPECT_EQ(picture->payload.data() + picture->payload.size(), bytes.data() + bytes.size())
        << "a view, no copy";
  }
}

TEST(PictureMessage, EveryReasonIsAmongTheSharedVectors) {
  const nlohmann::json vectors = Vectors();
  for (const WatchRefusal refusal : {WatchRefusal::kShort, WatchRefusal::kMagic, WatchRefusal::kHeader,
                                     WatchRefusal::kLength, WatchRefusal::kStream, WatchRefusal::kRange}) {
    const bool found = std::any_of(vectors.begin(), vectors.end(), [refusal](const nlohmann::json& vector) {
      return !vector["ok"].get<bool>() && vector["reason"].get<std::string>() == RefusalName(refusal);
    });
    EXPECT_TRUE(found) << RefusalName(refusal);
  }
}

TEST(PictureMessage, WritingThenReadingGivesTheSamePicture) {
  const WatchHeader header{.stream = WatchStream::kDepth,
                           .key_frame = true,
                           .frame = 0xFEDCBA9876543210u,
                           .capture_us = -5,
                           .encoded_us = 1'234'567'890'123,
                           .near_m = 1.25f,
                           .far_m = 6.5f};
  const std::vector<std::uint8_t> payload = {0, 0, 0, 1, 0x67, 9, 8, 7};
  const std::vector<std::uint8_t> message = WriteWatchPicture(header, payload);
  ASSERT_EQ(message.size(), kWatchHeaderBytes + payload.size());
  const auto picture = ReadWatchPicture(message);
  ASSERT_TRUE(picture);
  EXPECT_EQ(picture->header, header);
  EXPECT_TRUE(std::equal(picture->payload.begin(), picture->payload.end(), payload.begin(), payload.end()));
}

TEST(PictureMessage, WritesTheBytesOfTheSharedVectors) {
  for (const auto& vector : Vectors()) {
    const std::vector<std::uint8_t> bytes = FromHex(vector["hex"]);
    const auto picture = ReadWatchPicture(bytes);
    // Only those that a writer of this version makes: 48 bytes of header, no unknown flags, nothing reserved.
    if (!picture || bytes[6] != kWatchHeaderBytes || bytes[5] > 1 || bytes[44] != 0) continue;
    EXPECT_EQ(WriteWatchPicture(picture->header, picture->payload), bytes) << vector["name"];
  }
}

TEST(PictureMessage, NoChangedByteMakesItReadBeyondTheMessage) {
  std::mt19937 random(7);
  const std::vector<std::uint8_t> payload(20, 5);
  const std::vector<std::uint8_t> good =
      WriteWatchPicture({.stream = WatchStream::kDepth, .frame = 1, .near_m = 1, .far_m = 2}, payload);
  int refused = 0;
  for (int i = 0; i < 20'000; ++i) {
    std::vector<std::uint8_t> message = good;
    for (unsigned k = 0; k <= random() % 4; ++k)
      message[random() % message.size()] = static_cast<std::uint8_t>(random());
    message.resize(random() % (message.size() + 1));
    message.shrink_to_fit();  // so that the address sanitizer sees a byte too far
    if (const auto picture = ReadWatchPicture(message)) {
      EXPECT_LE(picture->payload.data() + picture->payload.size(), message.data() + message.size());
    } else {
      ++refused;
    }
  }
  EXPECT_GT(refused, 10'000);
}

}  // namespace
}  // namespace mixstage
