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
  config.regions = "/somewhere/regions.yaml";
  config.parity = 0.14;
  config.renderer = RendererChoice::kEgl;
  config.tokens = "/etc/mixstage/tokens.json";
  config.tls = {"/etc/mixstage/certificate.pem", "/etc/mixstage/key.pem"};
  config.audit = "/var/log/mixstage.jsonl";
  config.osc = "none";
  config.origins = {"https://studio.example", "http://localhost:5173"};
  config.hosts = {"studio.example"};
  const auto back = ParseStudioConfig(ToYaml(config), "/etc/studio.yaml");
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(ToYaml(*back), ToYaml(config));
  EXPECT_EQ(back->name, config.name);
}

TEST(StudioConfig, MistakesNameFileLineAndKey) {
  const std::pair<const char*, const char*> cases[] = {{"version: 1\nlisten_to: x\n", "listen_to"},
                                                       {"version: 2\n", "version"},
                                                       {"parity: 1.5\n", "parity"},
                                                       {"background:\n  learn_frames: 2\n", "learn_frames"},
                                                       {"color: {preset: slow}\n", "preset"},
                                                       {"renderer: vulkan\n", "renderer"},
                                                       {"color: {bitrate_mbps: .nan}\n", "bitrate_mbps"},
                                                       {"background: 7\n", "background"},
                                                       {"name: [a]\n", "name"},
                                                       {"tls: key.pem\n", "tls"},
                                                       {"tls: {cert: a.pem}\n", "cert"},
                                                       {"origins: https://a.example\n", "origins"},
                                                       {"hosts: [[a]]\n", "hosts"},
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
  const auto config = ParseStudioConfig("rig: ../rigs/a.json\ntls: {certificate: tls/a.pem, key: /b.pem}\n",
                                        "/etc/mixstage/studio.yaml");
  ASSERT_TRUE(config);
  EXPECT_EQ(config->tls.certificate, "/etc/mixstage/tls/a.pem");
  EXPECT_EQ(config->tls.key, "/b.pem");
  EXPECT_EQ(config->rig, "/etc/rigs/a.json");
}

TEST(StudioConfig, APathTooLongToBeReadAgainIsRefused) {
  const auto rig = [](std::size_t characters) {
    return ParseStudioConfig("rig: " + std::string(characters, 'r') + "\n", "/etc/mixstage/studio.yaml");
  };
  const auto longest = rig(512 - std::string("/etc/mixstage/").size());
  ASSERT_TRUE(longest);
  EXPECT_TRUE(ParseStudioConfig(ToYaml(*longest), "/etc/mixstage/studio.yaml"));
  ASSERT_FALSE(rig(512));
  EXPECT_NE(rig(512).error().message.find("rig is with its folder over 512"), std::string::npos);
}

TEST(ParseExports, AnUnknownNameListsTheKnown) {
  EXPECT_EQ(ParseExports("alpha,report")->size(), 2u);
  const auto bad = ParseExports("alpha,teapot");
  ASSERT_FALSE(bad);
  EXPECT_NE(bad.error().message.find("cg_alpha"), std::string::npos);
}

}  // namespace
}  // namespace mixstage
