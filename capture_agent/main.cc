// SPDX-License-Identifier: Apache-2.0
#include <pthread.h>
#include <signal.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <stop_token>
#include <thread>

#include "capture_agent/agent.h"
#include "capture_agent/head/synthetic_head.h"
#include "capture_agent/sources/synthetic_source.h"
#include "capture_agent/sources/synthetic_views.h"
#include "capture_agent/sources/take_source.h"
#include "proto/base/log.h"
#include "proto/base/version.h"

namespace mixstage {
namespace {

struct Options {
  std::string source, rig_file, lcm_url = kDefaultLcmUrl, rate = "real", log_level = "info", name = "head-1",
                                record, views;
  bool loop = false;
  double parity = kDefaultParity;
};

// The cameras, and what they stand on where the server may move it.
struct Rigged {
  std::unique_ptr<SyntheticHead> head;
  std::unique_ptr<Source> source;
};

Result<std::optional<Rig>> GivenRig(const Options& options) {
  if (options.rig_file.empty()) return std::optional<Rig>();
  auto rig = LoadRig(options.rig_file);
  if (!rig) return tl::unexpected(rig.error());
  for (const std::string& warning : rig->warnings) spdlog::warn("rig {}: {}", options.rig_file, warning);
  return std::optional<Rig>(rig->rig);
}

Result<Rigged> OpenSynthetic(const Options& options, Pace pace) {
  auto rig = GivenRig(options);
  if (!rig) return tl::unexpected(rig.error());
  Rigged rigged;
  if (!*rig || (*rig)->ptu) rigged.head = std::make_unique<SyntheticHead>();
  auto source = MakeSyntheticSource(*rig, {.figure = options.source == "synthetic"}, rigged.head.get(), pace);
  if (!source) return tl::unexpected(source.error());
  rigged.source = std::move(*source);
  return rigged;
}

Result<Rigged> OpenSource(const Options& options, Pace pace) {
  constexpr std::string_view kTake = "take:";
  if (options.source.starts_with(kTake)) {
    auto take = OpenTake(options.source.substr(kTake.size()));
    if (!take) return tl::unexpected(take.error());
    for (const std::string& warning : take->warnings) spdlog::warn("take {}", warning);
    spdlog::info("take folder={} color={} depth={} amplitude={} fisheye={}", take->folder.string(),
                 take->color.size(), take->depth.size(), take->amplitude.size(), take->fisheye.size());
    return Rigged{nullptr,
                  MakeTakeSource(std::move(*take), pace, options.loop ? AtEnd::kLoop : AtEnd::kStop)};
  }
  if (options.source == "synthetic" || options.source == "synthetic:empty")
    return OpenSynthetic(options, pace);
  return Fail(ErrorCode::kInvalidConfig,
              "--source " + options.source + " is neither take:DIR nor synthetic nor synthetic:empty");
}

// Writes the views and ends: nothing is published.
Status RecordViews(const Options& options) {
  if (options.source != "synthetic")
    return Fail(ErrorCode::kInvalidConfig, "--views: only --source synthetic knows its own views");
  if (options.record.empty())
    return Fail(ErrorCode::kInvalidConfig, "--views needs --record DIR, the folder to write");
  auto rig = GivenRig(options);
  if (!rig) return tl::unexpected(rig.error());
  const SyntheticViews views = options.views == "calibration" ? SyntheticViews::kCalibration
                               : options.views == "hand-eye"  ? SyntheticViews::kHandEye
                                                              : SyntheticViews::kScan;
  return WriteSyntheticViews(views, *rig, options.record);
}

// The rig.json that a recording gets: the one given, or the played take's.
std::optional<std::filesystem::path> RigFile(const Options& options) {
  if (!options.rig_file.empty()) return options.rig_file;
  constexpr std::string_view kTake = "take:";
  if (!options.source.starts_with(kTake)) return std::nullopt;
  return RigFileOf(options.source.substr(kTake.size()));
}

Status Run(const Options& options) {
  if (auto ok = StartLog("mixstage-agent", options.log_level); !ok) return ok;
  if (!options.views.empty()) return RecordViews(options);
  // Signals are taken by one thread that waits for them; blocked before any other thread starts.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  const Pace pace = options.rate == "real" ? Pace::kReal : Pace::kMax;
  auto rigged = OpenSource(options, pace);
  if (!rigged) return tl::unexpected(rigged.error());
  auto link = LcmLink::Create(options.lcm_url);
  if (!link) return tl::unexpected(link.error());

  std::unique_ptr<TakeRecorder> recorder;
  if (!options.record.empty()) {
    const TakeWriterConfig take{.folder = options.record, .rig_file = RigFile(options)};
    if (!take.rig_file)
      spdlog::warn("record no rig.json is known: give --rig, or put one into {}", options.record);
    recorder = std::make_unique<TakeRecorder>(take);
    if (auto ok = recorder->Start(); !ok) return Within("--record", ok.error());
  }

  std::stop_source stop;
  std::jthread signal_thread([&](const std::stop_token& done) {
    const timespec poll{0, 100'000'000};
    while (!done.stop_requested()) {
      if (sigtimedwait(&signals, nullptr, &poll) > 0) return (void)stop.request_stop();
    }
  });
  PublisherConfig config;
  config.name = options.name;
  config.parity = options.parity;
  spdlog::info("agent name={} source={} lcm={}", options.name, options.source, options.lcm_url);
  const AgentTotals t =
      RunAgent(*rigged->source, rigged->head.get(), pace, **link, config, recorder.get(), stop.get_token());
  spdlog::info("agent end captured={} published={} dropped={} unreadable={} send_errors={}", t.captured,
               t.published, t.dropped, t.unreadable, t.send_errors);
  if (t.captured == 0 && t.unreadable > 0) {
    return Fail(ErrorCode::kBadInput, "no picture of " + options.source + " could be read");
  }
  return {};
}

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  mixstage::Options options;
  CLI::App app{
      "Publishes the pictures of a camera head (colour, depth, amplitude, fisheye, angles) over LCM."};
  app.set_version_flag("--version", std::string("mixstage-agent ") + mixstage::kVersion);
  app.add_option("--source", options.source,
                 "take:DIR (a capture folder), synthetic (a room and a walking figure) or synthetic:empty "
                 "(no figure)")
      ->required();
  app.add_flag("--loop", options.loop, "take: start again at its end, times carried on");
  app.add_option("--rate", options.rate, "take: real time, or max (as fast as the network takes it)")
      ->check(CLI::IsMember({"real", "max"}))
      ->capture_default_str();
  app.add_option("--rig", options.rig_file,
                 "rig.json: whose cameras see the synthetic room; goes beside a recording");
  app.add_option("--record", options.record, "folder to record into (a new take), while publishing");
  app.add_option("--views", options.views,
                 "synthetic: record what calibrate and scan take into --record DIR, then end")
      ->check(CLI::IsMember({"calibration", "hand-eye", "scan"}));
  app.add_option("--lcm", options.lcm_url, "LCM URL")->capture_default_str();
  app.add_option(
         "--parity", options.parity,
         "share of parity against loss until the server says otherwise: 0.05 for 1 % loss, 0.14 for 5 %")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  app.add_option("--name", options.name, "how people call this head")->capture_default_str();
  app.add_option("--log-level", options.log_level, "trace, debug, info, warn, error or off")
      ->capture_default_str();
  app.footer(
      "Examples:\n  mixstage-agent --source synthetic\n  mixstage-agent --source take:recordings/monday "
      "--loop\n  "
      "mixstage-agent --source synthetic --views calibration --record views/calibration");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  if (auto ok = mixstage::Run(options); !ok) {
    std::fprintf(stderr, "mixstage-agent: %s\n", ok.error().message.c_str());
    return mixstage::ExitCode(ok.error());
  }
  return 0;
}
