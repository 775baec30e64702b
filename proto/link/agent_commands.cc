// SPDX-License-Identifier: Apache-2.0
#include "proto/link/agent_commands.h"

#include <algorithm>
#include <random>

namespace mixstage {

CommandSender::CommandSender() {
  // 62 random bits: counting on from there never overflows.
  std::random_device random;
  next_sequence_ = static_cast<std::int64_t>((std::uint64_t{random()} << 32 | random()) >> 2);
}

void CommandSender::Send(AgentCommand command, std::int64_t target_epoch) {
  Pending pending;
  pending.message.target_epoch = target_epoch;
  pending.message.verb = static_cast<std::int32_t>(command.verb);
  pending.message.value = command.value;
  const std::lock_guard lock(mutex_);
  pending.message.sequence = next_sequence_++;
  if (pending_.size() >= kMaxPending) pending_.pop_front();
  pending_.push_back(pending);
}

void CommandSender::SendDue(LcmLink& link, std::int64_t now_us) {
  std::deque<mixstage_lcm::agent_command_t> due;
  {
    const std::lock_guard lock(mutex_);
    for (Pending& p : pending_) {
      if (now_us < p.due_us) continue;
      due.push_back(p.message);
      --p.times_left;
      p.due_us = now_us + kPauseUs;
    }
    std::erase_if(pending_, [](const Pending& p) { return p.times_left == 0; });
  }
  // One that the socket refuses counts as one of the three that got lost.
  for (const auto& message : due) (void)link.Publish(message);
}

std::optional<AgentCommand> CommandReceiver::Take(const mixstage_lcm::agent_command_t& m) {
  if (m.target_epoch != kEveryAgent && m.target_epoch != epoch_) return std::nullopt;
  const bool parity = m.verb == static_cast<std::int32_t>(AgentVerb::kParity);
  const bool known = parity || m.verb == static_cast<std::int32_t>(AgentVerb::kRecord) ||
                     m.verb == static_cast<std::int32_t>(AgentVerb::kStopRecording);
  if (!known || (parity && (m.value < 0 || m.value > kMaxParityThousandths))) return std::nullopt;
  const auto done_end = done_.begin() + static_cast<std::ptrdiff_t>(std::min(done_count_, done_.size()));
  if (std::find(done_.begin(), done_end, m.sequence) != done_end) return std::nullopt;
  done_[done_count_++ % done_.size()] = m.sequence;
  return AgentCommand{static_cast<AgentVerb>(m.verb), m.value};
}

}  // namespace mixstage
