// SPDX-License-Identifier: Apache-2.0
#include "proto/link/agent_commands.h"

#include <gtest/gtest.h>

namespace mixstage {
namespace {

TEST(AgentCommands, AreSentThreeTimesAndDoneOnce) {
  auto link = LcmLink::Create("memq://");
  ASSERT_TRUE(link);
  CommandReceiver receiver(42);
  int heard = 0;
  std::vector<AgentCommand> done;
  (*link)->Subscribe({.on_command = [&](const mixstage_lcm::agent_command_t& m) {
    ++heard;
    if (const auto command = receiver.Take(m)) done.push_back(*command);
  }});
  CommandSender sender;
  sender.Send({AgentVerb::kParity, 140}, kEveryAgent);
  sender.Send({AgentVerb::kRecord, 0}, 42);
  sender.Send({AgentVerb::kStopRecording, 0}, 43);  // another agent's
  for (std::int64_t now_us = 0; now_us < 1'000'000; now_us += 20'000) sender.SendDue(**link, now_us);
  (*link)->HandleFor(100);
  EXPECT_EQ(heard, 9);
  ASSERT_EQ(done.size(), 2u);
  EXPECT_EQ(done[0].verb, AgentVerb::kParity);
  EXPECT_EQ(done[0].value, 140);
  EXPECT_EQ(done[1].verb, AgentVerb::kRecord);
}

TEST(AgentCommands, TheSameWishAgainIsANewCommand) {
  CommandReceiver receiver(1);
  mixstage_lcm::agent_command_t message{.target_epoch = 0, .sequence = 5, .verb = 1, .value = 0};
  EXPECT_TRUE(receiver.Take(message));
  EXPECT_FALSE(receiver.Take(message));
  message.sequence = 6;
  EXPECT_TRUE(receiver.Take(message));
}

TEST(AgentCommands, WhatMakesNoSenseIsNotDone) {
  CommandReceiver receiver(1);
  auto taken = [&, sequence = std::int64_t{0}](std::int32_t verb, std::int32_t value) mutable {
    mixstage_lcm::agent_command_t m{.target_epoch = 1, .sequence = ++sequence, .verb = verb, .value = value};
    return receiver.Take(m).has_value();
  };
  EXPECT_FALSE(taken(0, 0));
  EXPECT_FALSE(taken(4, 0));
  EXPECT_FALSE(taken(3, -1));
  EXPECT_FALSE(taken(3, 1001));
  EXPECT_TRUE(taken(3, 1000));
}

}  // namespace
}  // namespace mixstage
