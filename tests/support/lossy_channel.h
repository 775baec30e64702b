// SPDX-License-Identifier: Apache-2.0
//
// A bad network, reproducible: the same seed and datagrams give the same result.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <random>
#include <span>
#include <vector>

namespace mixstage {

struct LossyChannelConfig {
  std::uint64_t seed = 1;
  double drop = 0;  // share of datagrams lost, each by itself
  // Bursts (Gilbert-Elliott): from good to bad before a datagram, from bad to good before one, loss in the
  // bad state. Mean burst: 1 / burst_leave datagrams.
  double burst_enter = 0, burst_leave = 0.1, burst_loss = 1;
  int reorder = 0;       // a datagram is overtaken by others sent up to so many places later
  double duplicate = 0;  // share sent twice
  double truncate = 0;   // share cut off somewhere
  double flip = 0;       // share with 1 .. 8 bits turned over
};

class LossyChannel {
 public:
  using Bytes = std::vector<std::uint8_t>;
  using Deliver = std::function<void(const Bytes&)>;
  struct Counters {
    std::int64_t in = 0, out = 0, dropped = 0, duplicated = 0, truncated = 0, flipped = 0;
  };

  LossyChannel(const LossyChannelConfig& config, Deliver deliver);
  void Send(std::span<const std::uint8_t> datagram);
  void Flush();  // lets go of what waits to be overtaken
  [[nodiscard]] bool waiting() const { return !delayed_.empty(); }
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  bool Chance(double share) { return std::uniform_real_distribution<>(0, 1)(random_) < share; }
  std::uint64_t Below(std::uint64_t count) { return random_() % count; }
  void Enqueue(Bytes datagram);
  void DeliverUpTo(std::int64_t place);

  const LossyChannelConfig config_;
  const Deliver deliver_;
  std::mt19937_64 random_;
  bool bad_ = false;
  std::int64_t next_place_ = 0;
  std::multimap<std::int64_t, Bytes> delayed_;  // by the place at which they leave
  Counters counters_;
};

}  // namespace mixstage
