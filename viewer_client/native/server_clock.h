// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

namespace mixstage {

// The server's clock from pings: the answer with the shortest round trip of the last ones is taken to have
// been answered half way (off by half that round trip at most).
class ServerClock {
 public:
  void Answered(std::int64_t sent_us, std::int64_t received_us, std::int64_t server_us) {
    if (received_us < sent_us) return;  // not an answer to a ping of ours
    answers_.push_back({received_us - sent_us, server_us - (sent_us + received_us) / 2});
    if (answers_.size() > kAnswers) answers_.pop_front();
  }
  // Server's time minus ours; nothing before the first answer.
  [[nodiscard]] std::optional<std::int64_t> offset_us() const {
    const Answer* best = nullptr;
    for (const Answer& answer : answers_) {
      if (best == nullptr || answer.round_trip_us < best->round_trip_us) best = &answer;
    }
    return best == nullptr ? std::nullopt : std::optional(best->offset_us);
  }

 private:
  static constexpr std::size_t kAnswers = 16;
  struct Answer {
    std::int64_t round_trip_us, offset_us;
  };
  std::deque<Answer> answers_;
};

}  // namespace mixstage
