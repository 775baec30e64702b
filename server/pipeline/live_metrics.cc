// SPDX-License-Identifier: Apache-2.0
#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include "server/pipeline/live_show.h"

namespace mixstage {

// A registry is filled anew for each request: the show's own counters are the truth, and a scrape comes every
// few seconds at most.
std::string LiveShow::MetricsText() const {
  const WatchStats stats = Stats();
  prometheus::Registry registry;
  auto gauge = [&](const char* name, const char* help, double value) {
    prometheus::BuildGauge().Name(name).Help(help).Register(registry).Add({}).Set(value);
  };
  auto counter = [&](const char* name, const char* help) -> auto& {
    return prometheus::BuildCounter().Name(name).Help(help).Register(registry);
  };
  gauge("mixstage_live", "1 while the show is live, 0 while it learns, waits or lacks a stream",
        stats.state == "live");
  gauge("mixstage_frames_per_second", "Composites encoded per second over the last 2 s", stats.fps);
  prometheus::BuildGauge()
      .Name("mixstage_renderer_info")
      .Help("1, labelled with what depth and CG are drawn with")
      .Register(registry)
      .Add({{"renderer", renderer()}})
      .Set(1);
  gauge("mixstage_viewers", "Viewers connected", static_cast<double>(stats.viewers));
  gauge("mixstage_bitrate_bits_per_second", "Encoded, both streams", stats.bitrate_bps);
  gauge("mixstage_latency_seconds_p50", "Capture to encoded over the last 10 s, median",
        stats.latency_p50_ms * 1e-3);
  gauge("mixstage_latency_seconds_p99", "Capture to encoded over the last 10 s, 99th percentile",
        stats.latency_p99_ms * 1e-3);
  gauge("mixstage_depth_age_seconds", "Since the last depth picture", stats.depth_age_s);
  if (stats.depth_clock_ms)
    gauge("mixstage_depth_clock_offset_seconds",
          "Added to the times of depth pictures, by what the show tells", *stats.depth_clock_ms * 1e-3);
  gauge("mixstage_recording", "1 while what arrives is recorded", stats.recording.active);
  counter("mixstage_recording_dropped_total", "Pictures that the recording lacks")
      .Add({})
      .Increment(static_cast<double>(stats.recording.dropped));
  {
    const std::lock_guard lock(mutex_);
    gauge("mixstage_scene_revision", "Of the virtual scene that the last frame shows; 0 = none",
          static_cast<double>(scene_revision_));
  }
  counter("mixstage_frames_total", "Composites encoded").Add({}).Increment(static_cast<double>(stats.frames));
  auto& drops = counter("mixstage_drops_total", "Pictures and messages dropped, by reason");
  for (const auto& [reason, count] : stats.drops)
    drops.Add({{"reason", reason}}).Increment(static_cast<double>(count));
  auto& wall = counter("mixstage_stage_wall_seconds_total", "Wall time spent in a stage");
  auto& cpu = counter("mixstage_stage_cpu_seconds_total", "CPU time (user + system) spent in a stage");
  auto& runs = counter("mixstage_stage_runs_total", "Runs of a stage");
  for (const auto& [stage, sums] : times_.Sums()) {
    wall.Add({{"stage", stage}}).Increment(sums.wall_ms * 1e-3);
    cpu.Add({{"stage", stage}}).Increment(sums.cpu_ms * 1e-3);
    runs.Add({{"stage", stage}}).Increment(static_cast<double>(sums.count));
  }
  auto& agent_fps = prometheus::BuildGauge()
                        .Name("mixstage_agent_color_frames_per_second")
                        .Help("By the agent's own word")
                        .Register(registry);
  auto& agent_lost =
      counter("mixstage_agent_lost_total", "Colour pictures of an agent that never became whole");
  auto& agent_repaired =
      counter("mixstage_agent_repaired_total", "Pictures of an agent that parity made whole");
  auto agent_gauge = [&](const char* name, const char* help) -> auto& {
    return prometheus::BuildGauge().Name(name).Help(help).Register(registry);
  };
  auto& agent_slice_loss =
      agent_gauge("mixstage_agent_slice_loss_ratio", "Share of slices that did not arrive, last 10 s");
  auto& agent_delay = agent_gauge("mixstage_agent_delay_seconds",
                                  "Median time on the way beyond the fastest picture, last 10 s");
  auto& agent_recording = agent_gauge("mixstage_agent_recording", "1 while it writes a take of its own");
  for (const WatchAgent& agent : stats.agents) {
    agent_fps.Add({{"agent", agent.name}, {"epoch", agent.epoch}}).Set(agent.color_fps);
    agent_lost.Add({{"agent", agent.name}, {"epoch", agent.epoch}})
        .Increment(static_cast<double>(agent.lost));
    agent_repaired.Add({{"agent", agent.name}, {"epoch", agent.epoch}})
        .Increment(static_cast<double>(agent.repaired));
    agent_slice_loss.Add({{"agent", agent.name}, {"epoch", agent.epoch}}).Set(agent.slice_loss);
    agent_delay.Add({{"agent", agent.name}, {"epoch", agent.epoch}}).Set(agent.delay_ms * 1e-3);
    agent_recording.Add({{"agent", agent.name}, {"epoch", agent.epoch}}).Set(agent.recording);
  }
  return prometheus::TextSerializer().Serialize(registry.Collect());
}

}  // namespace mixstage
