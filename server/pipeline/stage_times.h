// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/clock.h"

namespace mixstage {

// Percentiles of a set of values; zeros for an empty set.
struct Distribution {
  double p50 = 0, p95 = 0, p99 = 0, max = 0, mean = 0;
};
Distribution DistributionOf(std::vector<float> values);

// Wall and CPU time of every stage: all of it for a report, a sliding window for live statistics. Any thread.
class StageTimes {
 public:
  // window: how many of a stage's last times are kept; 0 = all (offline).
  explicit StageTimes(std::size_t window) : window_(window) {}

  void Add(std::string_view stage, double wall_ms, double cpu_ms);

  struct Times {
    Distribution wall_ms, cpu_ms;
    std::int64_t count = 0;
  };
  [[nodiscard]] std::map<std::string, Times> Summary() const;
  // Sums since the start, for counters of a metrics page: [stage] = {wall_ms, cpu_ms, count}.
  struct Totals {
    double wall_ms = 0, cpu_ms = 0;
    std::int64_t count = 0;
  };
  [[nodiscard]] std::map<std::string, Totals> Sums() const;

 private:
  struct Series {
    std::vector<float> wall_ms, cpu_ms;
    std::size_t next = 0;
    Totals totals;
  };
  const std::size_t window_;
  mutable std::mutex mutex_;
  std::map<std::string, Series, std::less<>> series_;
};

// Measures from construction to destruction and adds to `times`.
class StageTimer {
 public:
  StageTimer(StageTimes& times, std::string_view stage)
      : times_(times), stage_(stage), wall_us_(MonotonicMicros()), cpu_us_(ThreadCpuMicros()) {}
  ~StageTimer() {
    times_.Add(stage_, static_cast<double>(MonotonicMicros() - wall_us_) * 1e-3,
               static_cast<double>(ThreadCpuMicros() - cpu_us_) * 1e-3);
  }
  StageTimer(const StageTimer&) = delete;
  StageTimer& operator=(const StageTimer&) = delete;

 private:
  StageTimes& times_;
  std::string_view stage_;
  std::int64_t wall_us_, cpu_us_;
};

}  // namespace mixstage
