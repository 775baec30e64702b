// SPDX-License-Identifier: Apache-2.0
//
// What a viewer saw, in numbers: the JSON line that `mixstage-view` ends with.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "proto/watch/picture_message.h"
#include "proto/watch/text_message.h"

namespace mixstage {

// Percentiles of latencies without keeping them: bins of 0.1 ms up to 5 s, all beyond in the last.
class LatencyHistogram {
 public:
  LatencyHistogram() : bins_(50'001) {}
  void Add(double ms);
  // The smallest bin's upper edge that holds `share` of all; nothing when there are none.
  [[nodiscard]] std::optional<double> Percentile(double share) const;
  void Clear();

 private:
  std::vector<std::uint32_t> bins_;
  std::uint64_t count_ = 0;
};

// A counter of the server, summed over its restarts: what was counted before the first reading is not ours.
class CounterSince {
 public:
  void Read(std::uint64_t value);
  [[nodiscard]] std::uint64_t total() const { return total_; }

 private:
  std::optional<std::uint64_t> last_;
  std::uint64_t total_ = 0;
};

struct ViewReport {
  double fps = 0;          // colour pictures decoded, first to last
  std::uint64_t late = 0;  // the server's drops.late while we watched
  std::uint64_t lost = 0;  // its drops.lost, and pictures that could not be decoded here
  std::optional<double> latency_p50_ms{}, latency_p99_ms{};  // capture to decoded
  std::uint64_t frames = 0;                                  // colour pictures decoded
  std::uint64_t gaps = 0;                                    // numbers between them that never came
  double depth_fps = 0;
  double bitrate_mbps = 0;  // both streams
  std::uint64_t reconnects = 0;
  std::optional<double> first_picture_ms{};  // from the start to the first colour picture
  float near_m = 0, far_m = 0;               // of the newest depth picture
};
// One line, keys in the order above.
[[nodiscard]] std::string ToJsonLine(const ViewReport& report);
// For a person, without the line's end.
[[nodiscard]] std::string ToSentence(const ViewReport& report);

// Times are this machine's monotonic clock. One thread at a time; bounded memory.
class ViewMeasure {
 public:
  explicit ViewMeasure(std::int64_t start_us) : start_us_(start_us) {}

  // latency_ms: capture to decoded, where the server's clock is known.
  void OnPicture(const WatchHeader& header, std::size_t message_bytes, std::int64_t now_us,
                 std::optional<double> latency_ms);
  void OnUndecodable() { ++undecodable_; }
  void OnStats(const WatchStats& stats);
  void OnConnected();

  // Of everything since the start.
  [[nodiscard]] ViewReport Total() const;
  // Of the pictures since the last call.
  [[nodiscard]] ViewReport TakeInterval();

 private:
  struct Span {  // of pictures
    std::uint64_t count = 0;
    std::int64_t first_us = 0, last_us = 0;
    void Add(std::int64_t now_us);
    [[nodiscard]] double Fps() const;
  };
  struct Window {
    std::array<Span, kWatchStreams> streams;
    std::uint64_t bytes = 0, gaps = 0;
    std::int64_t first_us = 0, last_us = 0;
    LatencyHistogram latency;
  };
  [[nodiscard]] ViewReport Report(const Window& window) const;

  const std::int64_t start_us_;
  Window total_, interval_;
  std::optional<std::uint64_t> last_frame_;
  std::optional<double> first_picture_ms_;
  CounterSince late_, lost_;
  std::uint64_t undecodable_ = 0, connections_ = 0;
  float near_m_ = 0, far_m_ = 0;
};

}  // namespace mixstage
