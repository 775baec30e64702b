// SPDX-License-Identifier: Apache-2.0
#include "server/app/config.h"

#include <gtest/gtest.h>

#include "server/app/process.h"

namespace mixstage {
namespace {

TEST(StudioConfig, TheSampleIsTheDefaults) {
  const auto sample = LoadStudioConfig(std::string(MIXSTAGE_SOURCE_DIR) + "/deploy/studio.yaml");
  ASSERT_TRUE(sample) << sample.error().message;
  EXPECT_EQ(ToYaml(*sample), ToYaml(StudioConfig{}));
}

TEST(StudioConfig, WhatIsPrintedReadsBack) {
  StudioConfig config;
  config.name = "a \"quoted\" \\ name\n\ton two lines";
  config.rig = "/somewhere/rig.json";
  config.color.preset = EncoderPreset::kVeryfast;
  config.depth.bitrate_bps = 3'500'000;
  config.learn_frames = 45;
  const auto back = ParseStudioConfig(ToYaml(config), "/etc/studio.yaml");
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(ToYaml(*back), ToYaml(config));
  EXPECT_EQ(back->name, config.name);
}

TEST(StudioConfig, MistakesNameFileLineAndKey) {
  const std::pair<const char*, const char*> cases[] = {{"version: 1\nlisten_to: x\n", "listen_to"},
                                                       {"version: 2\n", "version"},
                                                       {"background:\n  learn_frames: 2\n", "learn_frames"},
                                                       {"color: {preset: slow}\n", "preset"},
                                                       {"color: {bitrate_mbps: .nan}\n", "bitrate_mbps"},
                                                       {"background: 7\n", "background"},
                                                       {"name: [a]\n", "name"},
                                                       {"{", "studio.yaml"}};
  for (const auto& [text, word] : cases) {
    const auto config = ParseStudioConfig(text, "studio.yaml");
    ASSERT_FALSE(config) << text;
    EXPECT_EQ(config.error().code, ErrorCode::kInvalidConfig);
    EXPECT_NE(config.error().message.find(word), std::string::npos) << config.error().message;
    EXPECT_NE(config.error().message.find("studio.yaml"), std::string::npos) << config.error().message;
  }
}

TEST(StudioConfig, PathsAreRelativeToTheFile) {
  const auto config = ParseStudioConfig("rig: ../rigs/a.json\n", "/etc/mixstage/studio.yaml");
  ASSERT_TRUE(config);
  EXPECT_EQ(config->rig, "/etc/rigs/a.json");
}

TEST(ParseExports, AnUnknownNameListsTheKnown) {
  EXPECT_EQ(ParseExports("alpha,report")->size(), 2u);
  const auto bad = ParseExports("alpha,teapot");
  ASSERT_FALSE(bad);
  EXPECT_NE(bad.error().message.find("cg_alpha"), std::string::npos);
}

}  // namespace
}  // namespace mixstage
