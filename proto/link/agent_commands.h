// SPDX-License-Identifier: Apache-2.0
//
// What the server asks of agents (SPEC.md 2.5): each command is sent three times, because a datagram may be
// lost, and done once.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <mixstage_lcm/agent_command_t.hpp>
#include <mutex>
#include <optional>

#include "proto/link/lcm_link.h"

namespace mixstage {

enum class AgentVerb : std::int32_t { kRecord = 1, kStopRecording = 2, kParity = 3, kMoveHead = 4 };

inline constexpr std::int64_t kEveryAgent = 0;      // as target_epoch
inline constexpr int kMaxParityThousandths = 1000;  // value of kParity

struct AgentCommand {
  AgentVerb verb = AgentVerb::kRecord;
  int value = 0;                     // kParity
  double pan_deg = 0, tilt_deg = 0;  // kMoveHead: finite; the agent knows its head's limits
};

// The server's side. Send: any thread. SendDue: the thread that publishes on the link, now and then.
class CommandSender {
 public:
  static constexpr int kTimes = 3;
  static constexpr std::int64_t kPauseUs = 100'000;  // between repetitions: longer than a burst of loss
  static constexpr std::size_t kMaxPending = 64;     // the oldest are forgotten

  CommandSender();
  void Send(AgentCommand command, std::int64_t target_epoch);
  void SendDue(LcmLink& link, std::int64_t now_us);

 private:
  struct Pending {
    mixstage_lcm::agent_command_t message;
    int times_left = kTimes;
    std::int64_t due_us = 0;
  };
  std::mutex mutex_;
  std::int64_t next_sequence_;
  std::deque<Pending> pending_;
};

// The agent's side. One thread.
class CommandReceiver {
 public:
  explicit CommandReceiver(std::int64_t epoch) : epoch_(epoch) {}
  // The command, once; nothing when it is for another agent, was done, or makes no sense, and for a move of
  // the head that came after a later one: the last wish counts.
  std::optional<AgentCommand> Take(const mixstage_lcm::agent_command_t& message);

 private:
  const std::int64_t epoch_;
  std::array<std::int64_t, CommandSender::kMaxPending> done_{};  // sequences, the newest overwrite the oldest
  std::size_t done_count_ = 0;
  std::optional<std::int64_t> last_move_;  // sequence
};

}  // namespace mixstage
