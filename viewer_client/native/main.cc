// SPDX-License-Identifier: Apache-2.0
//
// mixstage-view: watches a server without a browser and says what came, in numbers.
#include <CLI/CLI.hpp>
#include <csignal>
#include <iostream>
#include <mutex>
#include <thread>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "proto/base/version.h"
#include "viewer_client/native/view_measure.h"
#include "viewer_client/native/watch_client.h"

namespace mixstage {
namespace {

constexpr const char* kExample =
    "Example: mixstage-view http://localhost:8090/ --seconds 10 --stats\n"
    "The last line is JSON. Exit code 0: pictures were decoded; 1: none came; 2: wrong usage.";

struct Options {
  std::string url;
  double seconds = 0;  // 0 = until interrupted
  bool stats = false, json = false;
  std::string log_level = "warn";
};

// What the client's thread and the printing one share.
struct Watched {
  explicit Watched(std::int64_t start_us) : measure(start_us) {}
  std::mutex mutex;
  ViewMeasure measure;       // guarded by mutex, as the rest
  std::string server_says;   // the server's message, empty when live
  std::string disconnected;  // why the last attempt ended; empty while connected
};

WatchCallbacks MeasureInto(Watched& watched) {
  const auto picture = [&watched](const WatchHeader& header, const PictureArrival& arrival) {
    std::optional<double> latency_ms;
    if (arrival.decoded_server_us) {
      latency_ms =
          (static_cast<double>(*arrival.decoded_server_us) - static_cast<double>(header.capture_us)) / 1e3;
    }
    const std::lock_guard lock(watched.mutex);
    watched.measure.OnPicture(header, arrival.message_bytes, MonotonicMicros(), latency_ms);
  };
  WatchCallbacks callbacks;
  callbacks.on_color = [picture](const ColorPicture& p, const PictureArrival& a) { picture(p.header, a); };
  callbacks.on_depth = [picture](const WatchedDepth& p, const PictureArrival& a) { picture(p.header, a); };
  callbacks.on_stats = [&watched](const WatchStats& stats) {
    const std::lock_guard lock(watched.mutex);
    watched.measure.OnStats(stats);
    watched.server_says = stats.message;
  };
  callbacks.on_undecodable = [&watched](WatchStream) {
    const std::lock_guard lock(watched.mutex);
    watched.measure.OnUndecodable();
  };
  callbacks.on_connected = [&watched] {
    const std::lock_guard lock(watched.mutex);
    watched.measure.OnConnected();
    watched.disconnected.clear();
  };
  callbacks.on_disconnected = [&watched](const std::string& why) {
    spdlog::info("view disconnected=\"{}\"", why);
    const std::lock_guard lock(watched.mutex);
    watched.disconnected = why;
  };
  return callbacks;
}

void PrintSecond(const Options& options, Watched& watched) {
  const std::lock_guard lock(watched.mutex);
  const ViewReport report = watched.measure.TakeInterval();
  if (options.json) {
    std::cout << ToJsonLine(report) << std::endl;
  } else if (report.frames == 0) {
    std::cout << "no picture: " << (watched.disconnected.empty() ? watched.server_says : watched.disconnected)
              << std::endl;
  } else {
    std::cout << ToSentence(report) << std::endl;
  }
}

// Until the time is over or somebody interrupts; SIGINT and SIGTERM are blocked in every thread.
void WaitAndPrint(const Options& options, Watched& watched, const sigset_t& signals) {
  const std::int64_t start_us = MonotonicMicros();
  std::int64_t next_print_us = start_us + 1'000'000;
  while (true) {
    const std::int64_t now_us = MonotonicMicros();
    std::int64_t wake_us = next_print_us;
    if (options.seconds > 0) {
      const std::int64_t end_us = start_us + static_cast<std::int64_t>(options.seconds * 1e6);
      if (now_us >= end_us) return;
      wake_us = std::min(wake_us, end_us);
    }
    if (now_us >= next_print_us) {
      if (options.stats) PrintSecond(options, watched);
      next_print_us += 1'000'000;
      continue;
    }
    const std::int64_t wait_us = std::max<std::int64_t>(wake_us - now_us, 0);
    const timespec timeout{wait_us / 1'000'000, (wait_us % 1'000'000) * 1000};
    if (sigtimedwait(&signals, nullptr, &timeout) > 0) return;
  }
}

int Run(const Options& options) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  Watched watched(MonotonicMicros());
  const Result<std::unique_ptr<WatchClient>> client =
      WatchClient::Create({.url = options.url}, MeasureInto(watched));
  if (!client) {
    std::cerr << "mixstage-view: " << client.error().message << "\n";
    return ExitCode(client.error());
  }
  {
    const std::jthread thread([&client](const std::stop_token& stop) { (*client)->Run(stop); });
    WaitAndPrint(options, watched, signals);
  }
  const ViewReport report = watched.measure.Total();
  std::cout << ToJsonLine(report) << std::endl;
  if (report.frames > 0) return 0;
  std::cerr << "mixstage-view: no picture came from " << options.url;
  if (!watched.disconnected.empty()) {
    std::cerr << ": " << watched.disconnected;
  } else if (!watched.server_says.empty()) {
    std::cerr << ": " << watched.server_says;
  }
  std::cerr << "\n";
  return 1;
}

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  mixstage::Options options;
  CLI::App app("Watches a MixStage server: decodes colour and depth and measures what comes.",
               "mixstage-view");
  app.footer(mixstage::kExample);
  app.set_version_flag("--version", std::string("mixstage-view ") + mixstage::kVersion);
  app.add_option("URL", options.url, "the page's address, http://HOST:PORT/")->required();
  app.add_option("--seconds", options.seconds, "how long to watch; 0 = until interrupted")
      ->check(CLI::Range(0.0, 1e7))
      ->capture_default_str();
  app.add_flag("--stats", options.stats, "a line every second");
  app.add_flag("--json", options.json, "JSON instead of sentences every second");
  app.add_option("--log-level", options.log_level, "trace, debug, info, warn, error or off")
      ->capture_default_str();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (const mixstage::Status log = mixstage::StartLog("mixstage-view", options.log_level); !log) {
    std::cerr << "mixstage-view: " << log.error().message << "\n";
    return mixstage::ExitCode(log.error());
  }
  return mixstage::Run(options);
}
