// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/mesh_message.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
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
  std::ifstream file(MIXSTAGE_SOURCE_DIR "/tests/vectors/watch_mesh.json");
  return nlohmann::json::parse(file);
}

std::vector<std::uint8_t> Bytes(std::span<const std::uint8_t> bytes) { return {bytes.begin(), bytes.end()}; }

TEST(MeshMessage, ReadsTheSharedVectorsAsTheyAreMeant) {
  for (const auto& vector : Vectors()) {
    SCOPED_TRACE(vector["name"].get<std::string>());
    const std::vector<std::uint8_t> bytes = FromHex(vector["hex"]);
    const auto mesh = ReadWatchMesh(bytes);
    ASSERT_EQ(mesh.has_value(), vector["ok"].get<bool>());
    if (!mesh) {
      EXPECT_EQ(RefusalName(mesh.error()), vector["reason"].get<std::string>());
      continue;
    }
    const auto& fields = vector["fields"];
    EXPECT_EQ(static_cast<int>(mesh->stream), fields["stream"].get<int>());
    EXPECT_EQ(std::to_string(mesh->frame), fields["frame"].get<std::string>());
    EXPECT_EQ(std::to_string(mesh->capture_us), fields["capture_us"].get<std::string>());
    EXPECT_EQ(std::to_string(mesh->encoded_us), fields["encoded_us"].get<std::string>());
    EXPECT_EQ(mesh->id, fields["id"].get<std::uint32_t>());
    EXPECT_EQ(mesh->T_scene_color, fields["T_scene_color"].get<WatchPose>());
    EXPECT_EQ(Bytes(mesh->mesh), FromHex(fields["mesh_hex"]));
    EXPECT_EQ(Bytes(mesh->texture), FromHex(fields["texture_hex"]));
    EXPECT_EQ(mesh->texture.data() + mesh->texture.size(), bytes.data() + bytes.size()) << "a view, no copy";
  }
}

TEST(MeshMessage, EveryReasonButTheRangeOfDepthIsAmongTheSharedVectors) {
  const nlohmann::json vectors = Vectors();
  for (const WatchRefusal refusal :
       {WatchRefusal::kShort, WatchRefusal::kMagic, WatchRefusal::kHeader, WatchRefusal::kLength,
        WatchRefusal::kStream, WatchRefusal::kParts, WatchRefusal::kId, WatchRefusal::kPose}) {
    const bool found = std::any_of(vectors.begin(), vectors.end(), [refusal](const nlohmann::json& vector) {
      return !vector["ok"].get<bool>() && vector["reason"].get<std::string>() == RefusalName(refusal);
    });
    EXPECT_TRUE(found) << RefusalName(refusal);
  }
}

TEST(MeshMessage, WritesTheBytesOfTheSharedVectors) {
  for (const auto& vector : Vectors()) {
    const std::vector<std::uint8_t> bytes = FromHex(vector["hex"]);
    const auto mesh = ReadWatchMesh(bytes);
    // Only those that a writer of this version makes: 48 bytes of header, the one flag.
    if (!mesh || bytes[6] != kWatchHeaderBytes || bytes[5] != 1) continue;
    EXPECT_EQ(WriteWatchMesh(*mesh), bytes) << vector["name"];
  }
}

TEST(MeshMessage, APictureIsNoMeshAndAMeshNoPicture) {
  const std::vector<std::uint8_t> payload(kMeshPrefixBytes, 0);
  EXPECT_EQ(ReadWatchMesh(WriteWatchPicture({.stream = WatchStream::kColor}, payload)).error(),
            WatchRefusal::kStream);
  EXPECT_EQ(ReadWatchPicture(WriteWatchMesh({.stream = WatchStream::kActorMesh})).error(),
            WatchRefusal::kStream);
}

TEST(MeshMessage, NoChangedByteMakesItReadBeyondTheMessage) {
  std::mt19937 random(11);
  const std::vector<std::uint8_t> part(20, 5);
  const std::vector<std::uint8_t> good =
      WriteWatchMesh({.stream = WatchStream::kObjectMesh, .id = 3, .mesh = part, .texture = part});
  int refused = 0;
  for (int i = 0; i < 20'000; ++i) {
    std::vector<std::uint8_t> message = good;
    for (unsigned k = 0; k <= random() % 4; ++k)
      message[random() % message.size()] = static_cast<std::uint8_t>(random());
    if (random() % 2 == 0) message.resize(random() % (message.size() + 1));
    message.shrink_to_fit();  // so that the address sanitizer sees a byte too far
    if (const auto mesh = ReadWatchMesh(message)) {
      EXPECT_GE(mesh->mesh.data(), message.data() + kWatchHeaderBytes + kMeshPrefixBytes);
      EXPECT_EQ(mesh->texture.data() + mesh->texture.size(), message.data() + message.size());
    } else {
      ++refused;
    }
  }
  EXPECT_GT(refused, 8'000);
}

}  // namespace
}  // namespace mixstage
