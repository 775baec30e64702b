// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/agent.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <string>
#include <thread>

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
  std::thread agent([&] { RunAgent(source, Pace::kReal, **link, {}, &recorder, stop.get_token()); });
  // The agent begins to listen some time; what it hears twice it does once.
  const auto ask_until = [&](std::int64_t sequence, AgentVerb verb, bool active) {
    while (recorder.status().active != active) {
      (*link)->Publish(mixstage_lcm::agent_command_t{
          .target_epoch = 0, .sequence = sequence, .verb = static_cast<std::int32_t>(verb), .value = 0});
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

}  // namespace
}  // namespace mixstage
