// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/agent.h"

#include <gtest/gtest.h>

#include <future>
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

TEST(Agent, DoesWhatTheServerAsksOnceWhileNoPictureComes) {
  auto link = LcmLink::Create("memq://");
  ASSERT_TRUE(link);
  SilentSource source;
  std::vector<bool> wishes;
  std::promise<void> both;
  const AgentHooks hooks{.on_record = [&](bool record) {
    wishes.push_back(record);
    if (wishes.size() == 2) both.set_value();
  }};
  std::stop_source stop;
  std::thread agent([&] { RunAgent(source, Pace::kReal, **link, {}, stop.get_token(), hooks); });
  // The agent begins to listen some time; what it hears twice it does once.
  auto done = both.get_future();
  mixstage_lcm::agent_command_t message{.target_epoch = 0, .sequence = 5, .verb = 1, .value = 0};
  while (done.wait_for(std::chrono::milliseconds(10)) != std::future_status::ready) {
    message = {.target_epoch = 0, .sequence = 5, .verb = 1, .value = 0};
    (*link)->Publish(message);
    message = {.target_epoch = 0, .sequence = 6, .verb = 2, .value = 0};
    (*link)->Publish(message);
  }
  stop.request_stop();
  agent.join();
  EXPECT_EQ(wishes, (std::vector<bool>{true, false}));
}

}  // namespace
}  // namespace mixstage
