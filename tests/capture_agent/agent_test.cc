// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/agent.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>

#include "capture_agent/head/synthetic_head.h"
#include "proto/base/clock.h"
#include "proto/link/agent_commands.h"

namespace mixstage {
namespace {

// A source whose next picture never comes.
class SilentSource : public Source {
 public:
  Result<std::optional<Captured>> Next(std::stop_token stop) override {
    while (WaitUntil(MonotonicMicros() + 1'000'000, stop)) {
    }
    return std::nullopt;
  }
};

TEST(Agent, RecordsWhileTheServerAsksForItThoughNoPictureComes) {
  auto link = LcmLink::Create("memq://");
  ASSERT_TRUE(link);
  SilentSource source;
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / ("agent_test_" + std::to_string(getpid()));
  TakeRecorder recorder({.folder = folder});
  std::stop_source stop;
  std::thread agent([&] { RunAgent(source, nullptr, Pace::kReal, **link, {}, &recorder, stop.get_token()); });
  // The agent begins to listen some time; what it hears twice it does once.
  const auto ask_until = [&](std::int64_t sequence, AgentVerb verb, bool active) {
    while (recorder.status().active != active) {
      (*link)->Publish(mixstage_lcm::agent_command_t{.target_epoch = 0,
                                                     .sequence = sequence,
                                                     .verb = static_cast<std::int32_t>(verb),
                                                     .value = 0,
                                                     .pan_deg = 0,
                                                     .tilt_deg = 0});
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
  };
  ask_until(5, AgentVerb::kRecord, true);
  ask_until(6, AgentVerb::kStopRecording, false);
  ask_until(7, AgentVerb::kRecord, true);
  stop.request_stop();
  agent.join();
  recorder.Stop();
  EXPECT_TRUE(std::filesystem::exists(folder / "rgb.txt"));
  EXPECT_TRUE(std::filesystem::exists(folder.string() + "-2/rgb.txt")) << "one take for each recording";
  std::filesystem::remove_all(folder);
  std::filesystem::remove_all(folder.string() + "-2");
}

TEST(Agent, MovesItsHeadAsAskedWithinItsLimitsAndTellsWhereItIs) {
  auto link = LcmLink::Create("memq://");
  ASSERT_TRUE(link);
  SilentSource source;
  SyntheticHead head;
  const std::filesystem::path folder =
      std::filesystem::path(testing::TempDir()) / ("agent_head_test_" + std::to_string(getpid()));
  TakeRecorder recorder({.folder = folder});
  ASSERT_TRUE(recorder.Start());
  std::stop_source stop;
  std::thread agent([&] { RunAgent(source, &head, Pace::kReal, **link, {}, &recorder, stop.get_token()); });
  mixstage_lcm::agent_command_t move{};
  move.verb = static_cast<std::int32_t>(AgentVerb::kMoveHead);
  const auto send = [&](std::int64_t sequence, double pan_deg, double tilt_deg) {
    move.sequence = sequence;
    move.pan_deg = pan_deg;
    move.tilt_deg = tilt_deg;
    (*link)->Publish(move);
  };
  // The agent begins to listen some time.
  while (head.settles_us() < 1'000'000) {
    send(1, 6, -2);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  send(2, 1e6, 0);
  send(3, 0, std::nan(""));
  WaitUntil(head.settles_us() + 250'000, {});
  stop.request_stop();
  agent.join();
  recorder.Stop();
  EXPECT_EQ(head.At(MonotonicMicros()).pan_deg, 6);
  EXPECT_EQ(head.At(MonotonicMicros()).tilt_deg, -2);
  std::ifstream angles(folder / "ptu.txt");
  std::string line, last;
  int lines = 0;
  for (; std::getline(angles, line); ++lines) last = line;
  EXPECT_GT(lines, 10) << "50 Hz";
  std::istringstream fields(last);
  double t_s = 0, pan_deg = 0, tilt_deg = 0;
  fields >> t_s >> pan_deg >> tilt_deg;
  EXPECT_NEAR(pan_deg, 6, 0.06);
  EXPECT_NEAR(tilt_deg, -2, 0.06);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace mixstage
