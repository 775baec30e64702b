// SPDX-License-Identifier: Apache-2.0
#include "proto/link/agent_commands.h"

#include <algorithm>
#include <cmath>
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
  pending.message.pan_deg = command.pan_deg;
  pending.message.tilt_deg = command.tilt_deg;
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
  const auto verb = static_cast<AgentVerb>(m.verb);
  switch (verb) {
    case AgentVerb::kRecord:
    case AgentVerb::kStopRecording:
      break;
    case AgentVerb::kParity:
      if (m.value < 0 || m.value > kMaxParityThousandths) return std::nullopt;
      break;
    case AgentVerb::kMoveHead:
      if (!std::isfinite(m.pan_deg) || !std::isfinite(m.tilt_deg)) return std::nullopt;
      break;
    default:
      return std::nullopt;
  }
  const auto done_end = done_.begin() + static_cast<std::ptrdiff_t>(std::min(done_count_, done_.size()));
  if (std::find(done_.begin(), done_end, m.sequence) != done_end) return std::nullopt;
  done_[done_count_++ % done_.size()] = m.sequence;
  if (verb == AgentVerb::kMoveHead) {
    // Unsigned: the network may send any number, and another server counts from another.
    const auto behind =
        static_cast<std::uint64_t>(last_move_.value_or(m.sequence)) - static_cast<std::uint64_t>(m.sequence);
    if (behind != 0 && behind <= CommandSender::kMaxPending) return std::nullopt;
    last_move_ = m.sequence;
  }
  return AgentCommand{verb, m.value, m.pan_deg, m.tilt_deg};
}

}  // namespace mixstage
