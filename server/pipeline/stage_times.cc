// SPDX-License-Identifier: Apache-2.0
#include "server/pipeline/stage_times.h"

#include <algorithm>
#include <numeric>

namespace mixstage {

Distribution DistributionOf(std::vector<float> values) {
  Distribution d;
  if (values.empty()) return d;
  std::sort(values.begin(), values.end());
  auto at = [&](double share) {
    return static_cast<double>(
        values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5)]);
  };
  d.p50 = at(0.50);
  d.p95 = at(0.95);
  d.p99 = at(0.99);
  d.max = values.back();
  d.mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  return d;
}

void StageTimes::Add(std::string_view stage, double wall_ms, double cpu_ms) {
  const std::lock_guard lock(mutex_);
  auto found = series_.find(stage);
  if (found == series_.end()) found = series_.emplace(std::string(stage), Series{}).first;
  Series& s = found->second;
  s.totals.wall_ms += wall_ms;
  s.totals.cpu_ms += cpu_ms;
  ++s.totals.count;
  if (window_ == 0 || s.wall_ms.size() < window_) {
    s.wall_ms.push_back(static_cast<float>(wall_ms));
    s.cpu_ms.push_back(static_cast<float>(cpu_ms));
    return;
  }
  s.wall_ms[s.next] = static_cast<float>(wall_ms);
  s.cpu_ms[s.next] = static_cast<float>(cpu_ms);
  s.next = (s.next + 1) % window_;
}

std::map<std::string, StageTimes::Times> StageTimes::Summary() const {
  const std::lock_guard lock(mutex_);
  std::map<std::string, Times> summary;
  for (const auto& [name, s] : series_) {
    summary[name] = {DistributionOf(s.wall_ms), DistributionOf(s.cpu_ms), s.totals.count};
  }
  return summary;
}

std::map<std::string, StageTimes::Totals> StageTimes::Sums() const {
  const std::lock_guard lock(mutex_);
  std::map<std::string, Totals> sums;
  for (const auto& [name, s] : series_) sums[name] = s.totals;
  return sums;
}

}  // namespace mixstage
