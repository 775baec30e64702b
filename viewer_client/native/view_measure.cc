// SPDX-License-Identifier: Apache-2.0
#include "viewer_client/native/view_measure.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "proto/base/log.h"

namespace mixstage {
namespace {

constexpr double kBinsPerMs = 10;

double Rounded(double value, double steps) { return std::round(value * steps) / steps; }

}  // namespace

void LatencyHistogram::Add(double ms) {
  const double bin = std::clamp(ms * kBinsPerMs, 0.0, static_cast<double>(bins_.size() - 1));
  ++bins_[static_cast<std::size_t>(bin)];
  ++count_;
}

std::optional<double> LatencyHistogram::Percentile(double share) const {
  if (count_ == 0) return std::nullopt;
  const auto wanted = static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(count_)));
  std::uint64_t seen = 0;
  for (std::size_t bin = 0; bin < bins_.size(); ++bin) {
    seen += bins_[bin];
    if (seen >= std::max<std::uint64_t>(wanted, 1)) return static_cast<double>(bin + 1) / kBinsPerMs;
  }
  return static_cast<double>(bins_.size()) / kBinsPerMs;
}

void LatencyHistogram::Clear() {
  std::fill(bins_.begin(), bins_.end(), 0u);
  count_ = 0;
}

void CounterSince::Read(std::uint64_t value) {
  // A counter that runs backwards belongs to a new server, which counted from 0.
  if (last_) total_ += value >= *last_ ? value - *last_ : value;
  last_ = value;
}

void ViewMeasure::Span::Add(std::int64_t now_us) {
  if (count++ == 0) first_us = now_us;
  last_us = now_us;
}

double ViewMeasure::Span::Fps() const {
  if (count < 2 || last_us <= first_us) return 0;
  return static_cast<double>(count - 1) * 1e6 / static_cast<double>(last_us - first_us);
}

void ViewMeasure::OnPicture(const WatchHeader& header, std::size_t message_bytes, std::int64_t now_us,
                            std::optional<double> latency_ms) {
  std::uint64_t gap = 0;
  const bool color = header.stream == WatchStream::kColor;
  if (color) {
    // Frame numbers that run backwards are a new server's.
    if (last_frame_ && header.frame > *last_frame_) gap = header.frame - *last_frame_ - 1;
    last_frame_ = header.frame;
    if (!first_picture_ms_) first_picture_ms_ = static_cast<double>(now_us - start_us_) / 1e3;
  } else {
    near_m_ = header.near_m;
    far_m_ = header.far_m;
  }
  for (Window* window : {&total_, &interval_}) {
    if (window->bytes == 0) window->first_us = now_us;
    window->last_us = now_us;
    window->bytes += message_bytes;
    window->gaps += gap;
    window->streams[StreamIndex(header.stream)].Add(now_us);
    if (color && latency_ms) window->latency.Add(*latency_ms);
  }
}

void ViewMeasure::OnStats(const WatchStats& stats) {
  const auto count = [&stats](const char* reason) {
    const auto it = stats.drops.find(reason);
    return it == stats.drops.end() ? 0 : it->second;
  };
  late_.Read(count("late"));
  lost_.Read(count("lost"));
}

void ViewMeasure::OnConnected() {
  ++connections_;
  last_frame_.reset();  // what went by meanwhile is a reconnect, not a gap
}

ViewReport ViewMeasure::Report(const Window& window) const {
  ViewReport report;
  const Span& color = window.streams[StreamIndex(WatchStream::kColor)];
  report.fps = color.Fps();
  report.late = late_.total();
  report.lost = lost_.total() + undecodable_;
  report.latency_p50_ms = window.latency.Percentile(0.5);
  report.latency_p99_ms = window.latency.Percentile(0.99);
  report.frames = color.count;
  report.gaps = window.gaps;
  report.depth_fps = window.streams[StreamIndex(WatchStream::kDepth)].Fps();
  if (window.last_us > window.first_us) {
    report.bitrate_mbps =
        static_cast<double>(window.bytes) * 8 / static_cast<double>(window.last_us - window.first_us);
  }
  report.reconnects = connections_ > 0 ? connections_ - 1 : 0;
  report.first_picture_ms = first_picture_ms_;
  report.near_m = near_m_;
  report.far_m = far_m_;
  return report;
}

ViewReport ViewMeasure::Total() const { return Report(total_); }

ViewReport ViewMeasure::TakeInterval() {
  ViewReport report = Report(interval_);
  interval_.streams = {};
  interval_.bytes = interval_.gaps = 0;
  interval_.latency.Clear();
  return report;
}

std::string ToJsonLine(const ViewReport& report) {
  const auto number = [](std::optional<double> value) -> nlohmann::ordered_json {
    if (!value) return nullptr;
    return Rounded(*value, 10);
  };
  const nlohmann::ordered_json json = {{"fps", Rounded(report.fps, 100)},
                                       {"late", report.late},
                                       {"lost", report.lost},
                                       {"latency_p50_ms", number(report.latency_p50_ms)},
                                       {"latency_p99_ms", number(report.latency_p99_ms)},
                                       {"frames", report.frames},
                                       {"gaps", report.gaps},
                                       {"depth_fps", Rounded(report.depth_fps, 100)},
                                       {"bitrate_mbps", Rounded(report.bitrate_mbps, 1000)},
                                       {"reconnects", report.reconnects},
                                       {"first_picture_ms", number(report.first_picture_ms)},
                                       {"near_m", Rounded(static_cast<double>(report.near_m), 1000)},
                                       {"far_m", Rounded(static_cast<double>(report.far_m), 1000)}};
  return json.dump();
}

std::string ToSentence(const ViewReport& report) {
  return fmt::format(
      "{:5.1f} fps, depth {:.1f} fps, latency {:.0f} ms (p99 {:.0f}), {:.1f} Mb/s, late {}, lost {}, "
      "gaps {}, depth {:.2f}-{:.2f} m",
      report.fps, report.depth_fps, report.latency_p50_ms.value_or(0), report.latency_p99_ms.value_or(0),
      report.bitrate_mbps, report.late, report.lost, report.gaps, report.near_m, report.far_m);
}

}  // namespace mixstage
