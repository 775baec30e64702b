// SPDX-License-Identifier: Apache-2.0
#include "proto/watch/text_message.h"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <random>

namespace mixstage {
namespace {

WatchStats FullStats() {
  return {.server_us = 123,
          .state = "no_depth",
          .message = "Depth stopped.",
          .fps = 29.5,
          .frames = 1000,
          .width = 1024,
          .height = 768,
          .latency_p50_ms = 41.5,
          .latency_p99_ms = 60.25,
          .bitrate_bps = 6e6,
          .viewers = 2,
          .drops = {{"late", 3}, {"lost", 5}},
          .stages = {{"warp_depth", 3.0, 2.5, 2.25}},
          .agents = {{"0123456789abcdef", "head-1", 0.2, 30, 12.5, 1, 2, 2.0, 4, 9, 0.01, 1.5, true}},
          .depth_age_s = 3.5,
          .depth_clock_ms = -12.5,
          .recording = {true, 12.5, 3},
          .contacts = {{0.5, "touch", "vase", "floor", 1.25, ""}},
          .scan = WatchScan{.state = "compute",
                            .age_s = 0.5,
                            .positions = 6,
                            .recorded = 5,
                            .left_out = 1,
                            .columns = 3,
                            .rows = 2,
                            .cells = "112111",
                            .pan_deg = {30, -30},
                            .tilt_deg = {10, -10},
                            .text = "register",
                            .notes = "pan -30.0 tilt 10.0: no colour picture came\n",
                            .coverage = 0,
                            .triangles = 0},
          .T_scene_color = {{0, 0, 1, 2, -1, 0, 0, 0.5, 0, -1, 0, 1.5}}};
}

TEST(ServerMessage, HelloComesBack) {
  const WatchHello hello{.name = "studio \"one\"",
                         .server_us = 1234567890123,
                         .role = WatchRole::kDirector,
                         .streams = {{WatchStream::kColor, "avc1.42C01F", 1024, 768},
                                     {WatchStream::kDepth, "avc1.6E001F", 1024, 768}}};
  const auto message = ParseServerMessage(ToJson(hello));
  ASSERT_TRUE(message) << message.error().message;
  const auto& read = std::get<WatchHello>(*message);
  EXPECT_EQ(read.name, hello.name);
  EXPECT_EQ(read.server_us, hello.server_us);
  EXPECT_EQ(read.role, hello.role);
  EXPECT_EQ(read.streams, hello.streams);
  EXPECT_EQ(read.camera, std::nullopt);
}

TEST(ServerMessage, HelloSaysTheCameraWhereItIsKnown) {
  const WatchHello hello{.camera = WatchCamera{1024, 768, 1094, 1093.5, 521.5, 375.25}};
  const auto message = ParseServerMessage(ToJson(hello));
  ASSERT_TRUE(message) << message.error().message;
  EXPECT_EQ(std::get<WatchHello>(*message).camera, hello.camera);
  for (const char* name : {"width", "height", "fx", "fy", "cx", "cy"}) {
    nlohmann::json json = nlohmann::json::parse(ToJson(hello));
    json["camera"][name] = "x";
    const auto refused = ParseServerMessage(json.dump());
    ASSERT_FALSE(refused) << name;
    EXPECT_NE(refused.error().message.find(name), std::string::npos) << refused.error().message;
  }
  nlohmann::json json = nlohmann::json::parse(ToJson(hello));
  json["camera"]["fx"] = 0;
  EXPECT_FALSE(ParseServerMessage(json.dump()));
}

TEST(ServerMessage, StatsHaveTheFieldsOfTheSpecification) {
  const nlohmann::json json = nlohmann::json::parse(ToJson(FullStats()));
  const nlohmann::json expected =
      nlohmann::json::parse(R"({"type": "stats", "server_us": 123, "state": "no_depth",
    "message": "Depth stopped.", "fps": 29.5, "frames": 1000, "width": 1024, "height": 768,
    "latency_ms": {"p50": 41.5, "p99": 60.25}, "bitrate_bps": 6000000, "viewers": 2,
    "drops": {"late": 3, "lost": 5},
    "stages": [{"name": "warp_depth", "budget_ms": 3.0, "wall_ms": 2.5, "cpu_ms": 2.25}],
    "agents": [{"epoch": "0123456789abcdef", "name": "head-1", "age_s": 0.2, "color_fps": 30.0, "depth_fps": 12.5,
                "drops": 1, "queue": 2, "encode_ms": 2.0, "lost": 4,
                "repaired": 9, "slice_loss": 0.01, "delay_ms": 1.5, "recording": true}],
    "depth_age_s": 3.5, "depth_clock_ms": -12.5, "recording": {"active": true, "seconds": 12.5, "dropped": 3},
    "contacts": [{"age_s": 0.5, "event": "touch", "object": "vase", "with": "floor", "impulse_ns": 1.25, "text": ""}],
    "scan": {"state": "compute", "age_s": 0.5, "positions": 6, "recorded": 5, "left_out": 1, "columns": 3, "rows": 2,
             "cells": "112111", "pan_deg": [30.0, -30.0], "tilt_deg": [10.0, -10.0], "text": "register",
             "notes": "pan -30.0 tilt 10.0: no colour picture came\n", "coverage": 0.0, "triangles": 0},
    "T_scene_color": [0.0, 0.0, 1.0, 2.0, -1.0, 0.0, 0.0, 0.5, 0.0, -1.0, 0.0, 1.5]})");
  EXPECT_EQ(json, expected);
}

TEST(ServerMessage, StatsComeBack) {
  const auto message = ParseServerMessage(ToJson(FullStats()));
  ASSERT_TRUE(message) << message.error().message;
  EXPECT_EQ(ToJson(std::get<WatchStats>(*message)), ToJson(FullStats()));
}

TEST(ServerMessage, WhatNoNumberCanSayIsWrittenReadable) {
  WatchStats stats = FullStats();
  stats.fps = std::numeric_limits<double>::quiet_NaN();
  stats.bitrate_bps = std::numeric_limits<double>::infinity();
  stats.message = "\xFF\xFE broken";
  const auto message = ParseServerMessage(ToJson(stats));
  ASSERT_TRUE(message) << message.error().message;
  EXPECT_EQ(std::get<WatchStats>(*message).fps, 0);
}

TEST(ServerMessage, AnotherProtocolIsRefusedByNumber) {
  nlohmann::json json = nlohmann::json::parse(ToJson(WatchHello{}));
  json["protocol"] = 2;
  const auto message = ParseServerMessage(json.dump());
  ASSERT_FALSE(message);
  EXPECT_NE(message.error().message.find("protocol 2"), std::string::npos);
}

TEST(ServerMessage, FieldsOfALaterVersionAreSkipped) {
  nlohmann::json json = nlohmann::json::parse(ToJson(FullStats()));
  json["later"] = {1, 2, 3};
  EXPECT_TRUE(ParseServerMessage(json.dump()));
}

TEST(ServerMessage, EveryMissingOrMistypedFieldIsRefusedByName) {
  const nlohmann::json good = nlohmann::json::parse(ToJson(FullStats()));
  for (const auto& [name, value] : good.items()) {
    nlohmann::json missing = good;
    missing.erase(name);
    EXPECT_EQ(ParseServerMessage(missing.dump()).has_value(),
              name == "T_scene_color" || name == "scan" || name == "contacts" || name == "depth_clock_ms")
        << name;
    nlohmann::json mistyped = good;
    mistyped[name] = nullptr;
    const auto message = ParseServerMessage(mistyped.dump());
    ASSERT_FALSE(message) << name;
    EXPECT_NE(message.error().message.find(name), std::string::npos) << message.error().message;
  }
}

TEST(ServerMessage, EveryWrongFieldOfAScanIsRefusedByName) {
  const nlohmann::json good = nlohmann::json::parse(ToJson(FullStats()));
  for (const auto& [name, value] : good["scan"].items()) {
    nlohmann::json wrong = good;
    wrong["scan"][name] = nullptr;
    const auto message = ParseServerMessage(wrong.dump());
    ASSERT_FALSE(message) << name;
    EXPECT_NE(message.error().message.find(name), std::string::npos) << message.error().message;
  }
  for (const auto& [name, value] : {std::pair<const char*, nlohmann::json>{"state", "asleep"},
                                    {"cells", "11211"},
                                    {"cells", "112114"},
                                    {"rows", 513},
                                    {"columns", -1}}) {
    nlohmann::json wrong = good;
    wrong["scan"][name] = value;
    EXPECT_FALSE(ParseServerMessage(wrong.dump())) << name;
  }
}

TEST(Pong, GivesThePingsNumberBack) {
  for (const double number : {0.0, 1.5, -3.0, 9007199254740991.0, 1784732123456789.0}) {
    const auto ping = ParseViewerMessage(ToJson(WatchPing{number}));
    ASSERT_TRUE(ping);
    const auto pong = ParseServerMessage(ToJson(WatchPong{std::get<WatchPing>(*ping).viewer_us, 5}));
    ASSERT_TRUE(pong);
    EXPECT_EQ(std::get<WatchPong>(*pong).viewer_us, number);
  }
  EXPECT_EQ(ToJson(WatchPong{1784732123456789.0, 5}),
            R"({"server_us":5,"type":"pong","viewer_us":1784732123456789})");
}

TEST(ViewerMessage, SubscribeAndKeyFrameComeBack) {
  for (const bool color : {false, true}) {
    for (const bool depth : {false, true}) {
      for (const bool mesh : {false, true}) {
        const auto message = ParseViewerMessage(ToJson(WatchSubscribe{color, depth, mesh}));
        ASSERT_TRUE(message);
        EXPECT_EQ(std::get<WatchSubscribe>(*message).color, color);
        EXPECT_EQ(std::get<WatchSubscribe>(*message).depth, depth);
        EXPECT_EQ(std::get<WatchSubscribe>(*message).mesh, mesh);
      }
    }
  }
  const auto wish = ParseViewerMessage(ToJson(WatchKeyFrameWish{}));
  ASSERT_TRUE(wish);
  EXPECT_TRUE(std::holds_alternative<WatchKeyFrameWish>(*wish));
}

TEST(ViewerMessage, RubbishIsRefused) {
  const std::string deep = std::string(2000, '[') + std::string(2000, ']');
  for (const std::string& text :
       {std::string(), std::string("{"), std::string("[]"), std::string("null"), std::string("{\"type\":1}"),
        std::string("{\"type\":\"reboot\"}"), std::string("{\"type\":\"ping\"}"),
        std::string("{\"type\":\"ping\",\"viewer_us\":\"1\"}"),
        std::string("{\"type\":\"ping\",\"viewer_us\":1e999}"),
        std::string("{\"type\":\"ping\",\"viewer_us\":1} more"), std::string("{\"type\":\"subscribe\"}"),
        std::string("{\"type\":\"subscribe\",\"streams\":[\"sound\"]}"),
        std::string("{\"type\":\"subscribe\",\"streams\":[1]}"),
        std::string(
            "{\"type\":\"subscribe\",\"streams\":[\"color\",\"color\",\"color\",\"color\",\"color\"]}"),
        deep, "{\"type\":\"ping\",\"viewer_us\":" + deep + "}",
        "{\"type\":\"keyframe\",\"x\":\"" + std::string(5000, 'x') + "\"}"}) {
    const auto message = ParseViewerMessage(text);
    ASSERT_FALSE(message) << text.substr(0, 60);
    EXPECT_EQ(message.error().code, ErrorCode::kBadInput);
    EXPECT_FALSE(message.error().message.empty());
  }
}

TEST(ViewerMessage, ChangedBytesNeverDoMoreThanBeRefused) {
  std::mt19937 random(3);
  const std::string good = ToJson(WatchSubscribe{true, true});
  int refused = 0;
  for (int i = 0; i < 20'000; ++i) {
    std::string text = good;
    for (unsigned k = 0; k <= random() % 3; ++k) text[random() % text.size()] = static_cast<char>(random());
    text.resize(random() % (text.size() + 1));
    if (!ParseViewerMessage(text)) ++refused;
    if (!ParseServerMessage(text)) ++refused;
  }
  EXPECT_GT(refused, 20'000);
}

}  // namespace
}  // namespace mixstage
