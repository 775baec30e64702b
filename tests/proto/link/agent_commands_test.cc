// SPDX-License-Identifier: Apache-2.0
#include "proto/link/agent_commands.h"

#include <gtest/gtest.h>

#include <cmath>

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
  sender.Send({.verb = AgentVerb::kParity, .value = 140}, kEveryAgent);
  sender.Send({.verb = AgentVerb::kRecord}, 42);
  sender.Send({.verb = AgentVerb::kStopRecording}, 43);  // another agent's
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
  mixstage_lcm::agent_command_t message{
      .target_epoch = 0, .sequence = 5, .verb = 1, .value = 0, .pan_deg = 0, .tilt_deg = 0};
  EXPECT_TRUE(receiver.Take(message));
  EXPECT_FALSE(receiver.Take(message));
  message.sequence = 6;
  EXPECT_TRUE(receiver.Take(message));
}

TEST(AgentCommands, WhatMakesNoSenseIsNotDone) {
  CommandReceiver receiver(1);
  auto taken = [&, sequence = std::int64_t{0}](std::int32_t verb, std::int32_t value) mutable {
    mixstage_lcm::agent_command_t m{
        .target_epoch = 1, .sequence = ++sequence, .verb = verb, .value = value, .pan_deg = 0, .tilt_deg = 0};
    return receiver.Take(m).has_value();
  };
  EXPECT_FALSE(taken(0, 0));
  EXPECT_FALSE(taken(5, 0));
  EXPECT_FALSE(taken(-1, 0));
  EXPECT_FALSE(taken(3, -1));
  EXPECT_FALSE(taken(3, 1001));
  EXPECT_TRUE(taken(3, 1000));
}

mixstage_lcm::agent_command_t Move(std::int64_t sequence, double pan_deg, double tilt_deg) {
  mixstage_lcm::agent_command_t m{};
  m.sequence = sequence;
  m.verb = static_cast<std::int32_t>(AgentVerb::kMoveHead);
  m.pan_deg = pan_deg;
  m.tilt_deg = tilt_deg;
  return m;
}

TEST(AgentCommands, AHeadThatIsMovedToNoAngleStays) {
  CommandReceiver receiver(1);
  EXPECT_FALSE(receiver.Take(Move(1, std::nan(""), 0)));
  EXPECT_FALSE(receiver.Take(Move(2, 0, INFINITY)));
  const auto move = receiver.Take(Move(3, -12.5, 4));
  ASSERT_TRUE(move);
  EXPECT_EQ(move->verb, AgentVerb::kMoveHead);
  EXPECT_EQ(move->pan_deg, -12.5);
  EXPECT_EQ(move->tilt_deg, 4);
}

// Two moves are sent three times each; the network loses and doubles them and changes their order.
TEST(AgentCommands, OfMovesThatOvertakeEachOtherTheLastWishCounts) {
  CommandReceiver receiver(1);
  EXPECT_TRUE(receiver.Take(Move(8, 20, 0)));   // the first of its three that came
  EXPECT_FALSE(receiver.Take(Move(7, 10, 0)));  // the one before, late
  EXPECT_FALSE(receiver.Take(Move(8, 20, 0)));
  EXPECT_TRUE(receiver.Take(Move(9, 30, 0)));
  EXPECT_FALSE(receiver.Take(Move(8, 20, 0)));
  // Another server counts from elsewhere, forwards or back.
  EXPECT_TRUE(receiver.Take(Move(1'000'000, 1, 0)));
  EXPECT_TRUE(receiver.Take(Move(-5'000'000'000'000'000'000, 2, 0)));
  EXPECT_TRUE(receiver.Take(Move(5'000'000'000'000'000'000, 3, 0)));
}

}  // namespace
}  // namespace mixstage
