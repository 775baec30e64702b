// SPDX-License-Identifier: Apache-2.0
#include "tests/support/lossy_channel.h"

#include <limits>
#include <utility>

namespace mixstage {

LossyChannel::LossyChannel(const LossyChannelConfig& config, Deliver deliver)
    : config_(config), deliver_(std::move(deliver)), random_(config.seed) {}

void LossyChannel::Send(std::span<const std::uint8_t> datagram) {
  ++counters_.in;
  bad_ = bad_ ? !Chance(config_.burst_leave) : Chance(config_.burst_enter);
  if ((bad_ && Chance(config_.burst_loss)) || Chance(config_.drop)) {
    ++counters_.dropped;
    return;
  }
  Bytes bytes(datagram.begin(), datagram.end());
  if (Chance(config_.truncate) && !bytes.empty()) {
    bytes.resize(Below(bytes.size()));
    ++counters_.truncated;
  }
  if (Chance(config_.flip) && !bytes.empty()) {
    for (std::uint64_t bits = 1 + Below(8); bits > 0; --bits) {
      auto& byte = bytes[Below(bytes.size())];
      byte = static_cast<std::uint8_t>(byte ^ (1u << Below(8)));
    }
    ++counters_.flipped;
  }
  if (Chance(config_.duplicate)) {
    ++counters_.duplicated;
    Enqueue(bytes);
  }
  Enqueue(std::move(bytes));
}

void LossyChannel::Enqueue(Bytes datagram) {
  const std::int64_t place = next_place_++;
  const auto delay = static_cast<std::int64_t>(Below(static_cast<std::uint64_t>(config_.reorder) + 1));
  delayed_.emplace(place + delay, std::move(datagram));
  DeliverUpTo(place);
}

void LossyChannel::DeliverUpTo(std::int64_t place) {
  while (!delayed_.empty() && delayed_.begin()->first <= place) {
    ++counters_.out;
    deliver_(delayed_.begin()->second);
    delayed_.erase(delayed_.begin());
  }
}

void LossyChannel::Flush() { DeliverUpTo(std::numeric_limits<std::int64_t>::max()); }

}  // namespace mixstage
