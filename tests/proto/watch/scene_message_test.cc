// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/scene_message.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <set>

#include "proto/watch/text_message.h"

namespace mixstage {
namespace {

nlohmann::json Vectors() {
  std::ifstream file(MIXSTAGE_SOURCE_DIR "/tests/vectors/scene_message.json");
  return nlohmann::json::parse(file);
}

// What was read, written again; or why it was refused.
std::string ReadAndWrite(const nlohmann::json& vector) {
  const std::string text = vector["message"].dump();
  if (vector["from"] == "server") {
    const auto message = ParseServerMessage(text);
    return message ? std::visit([](const auto& m) { return ToJson(m); }, *message) : message.error().message;
  }
  const auto message = ParseViewerMessage(text);
  return message ? std::visit([](const auto& m) { return ToJson(m); }, *message) : message.error().message;
}

TEST(SceneMessage, SharedVectorsAreReadAsTheyAreMeant) {
  for (const nlohmann::json& vector : Vectors()) {
    SCOPED_TRACE(vector["name"].get<std::string>());
    const std::string answer = ReadAndWrite(vector);
    if (!vector["ok"].get<bool>()) {
      EXPECT_EQ(answer, vector["reason"].get<std::string>());
      continue;
    }
    nlohmann::json expected = vector["message"];
    expected.erase("later");
    if (expected.contains("live") && !expected["live"].get<bool>())
      expected.erase("live");  // left out as usual
    const nlohmann::json written = nlohmann::json::parse(answer, nullptr, false);
    ASSERT_FALSE(written.is_discarded()) << answer;
    EXPECT_EQ(written, expected);
  }
}

TEST(SceneMessage, EveryOpIsAmongTheSharedVectors) {
  std::set<std::string> seen;
  for (const nlohmann::json& vector : Vectors()) {
    if (vector["ok"].get<bool>() && vector["message"].contains("op")) seen.insert(vector["message"]["op"]);
  }
  EXPECT_EQ(seen.size(), std::variant_size_v<EditOp>);
}

TEST(SceneMessage, TheLargestSceneFitsAMessage) {
  WatchScene scene;
  WatchObject object;
  object.name = std::string(512, 'n');
  object.file = std::string(512, 'f');
  object.pose.fill(-1.0 / 3.0e5);
  object.bounds.fill(-1.0 / 3.0e5);
  for (std::uint32_t id = 1; id <= kMaxSceneObjects; ++id) {
    object.id = id;
    scene.objects.push_back(object);
  }
  for (std::uint32_t id = 1; id <= kMaxSceneLights; ++id)
    scene.lights.push_back({.id = id, .name = object.name});
  scene.models.assign(kMaxSceneModels, std::string(255, 'm'));
  const auto message = ParseServerMessage(ToJson(scene));
  ASSERT_TRUE(message) << message.error().message;
  EXPECT_EQ(std::get<WatchScene>(*message), scene);
  scene.objects.push_back(object);
  EXPECT_FALSE(ParseServerMessage(ToJson(scene)));
}

TEST(SceneMessage, ChangedBytesNeverDoMoreThanBeRefused) {
  std::mt19937 random(5);
  const nlohmann::json vectors = Vectors();
  int read = 0;
  for (int i = 0; i < 20'000; ++i) {
    std::string text = vectors[random() % vectors.size()]["message"].dump();
    for (unsigned k = 0; k <= random() % 3; ++k) text[random() % text.size()] = static_cast<char>(random());
    if (ParseViewerMessage(text)) ++read;
    if (ParseServerMessage(text)) ++read;
  }
  EXPECT_GT(read, 0);  // a changed digit is another good message
}

}  // namespace
}  // namespace mixstage
