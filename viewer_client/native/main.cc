// SPDX-License-Identifier: Apache-2.0
//
// mixstage-view: watches a server without a browser and says what came, in numbers.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <mutex>
#include <thread>

#include "proto/base/clock.h"
#include "proto/base/log.h"
#include "proto/base/version.h"
#include "viewer_client/native/mesh_dump.h"
#include "viewer_client/native/picture_dump.h"
#include "viewer_client/native/picture_window.h"
#include "viewer_client/native/view_measure.h"
#include "viewer_client/native/watch_client.h"

namespace mixstage {
namespace {

constexpr const char* kFooter =
    "Examples:\n"
    "  mixstage-view http://localhost:8090/ --seconds 10 --stats\n"
    "  mixstage-view https://studio.example/ --token token.txt --ca studio.pem --dump pictures\n"
    "The token of a server that asks for a login comes from --token or the variable MIXSTAGE_TOKEN.\n"
    "The last line is JSON. Exit code 0: pictures were decoded; 1: none came; 2: wrong usage, or no display\n"
    "for --window; 3: the server refused the login.";

constexpr int kNoPicture = 1, kLoginRefused = 3;

struct Options {
  std::string url, token_file, ca_file, dump;
  double seconds = 0;  // 0 = until interrupted
  bool stats = false, json = false, insecure = false, window = false;
  std::string log_level = "warn";
};

// The first line of a file, of standard input ("-"), or the variable MIXSTAGE_TOKEN; empty = none.
Result<std::string> ReadToken(const std::string& file) {
  std::string token;
  if (file.empty()) {
    const char* variable = std::getenv("MIXSTAGE_TOKEN");
    return variable != nullptr ? std::string(variable) : std::string();
  }
  std::ifstream in(file == "-" ? "/dev/stdin" : file);
  if (!std::getline(in, token) || token.empty()) {
    return Fail(ErrorCode::kInvalidConfig, "--token " + file + ": holds no token");
  }
  if (token.ends_with('\r')) token.pop_back();
  return token;
}

// What the client's thread and the printing one share.
struct Watched {
  explicit Watched(std::int64_t start_us) : measure(start_us) {}
  std::mutex mutex;
  ViewMeasure measure;       // guarded by mutex, as the rest
  std::string server_says;   // the server's message, empty when live
  std::string disconnected;  // why the last attempt ended; empty while connected
};

// Where the pictures go, besides being counted; null = nowhere.
struct Outputs {
  std::unique_ptr<PictureDump> dump;
  std::unique_ptr<MeshDump> meshes;
  std::unique_ptr<PictureWindow> window;
};

WatchCallbacks Callbacks(Watched& watched, const Outputs& out) {
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
  callbacks.on_color = [picture, &out](const ColorPicture& p, const PictureArrival& a) {
    picture(p.header, a);
    if (out.dump) out.dump->Color(p);
    if (out.window) out.window->SetColor(p);
  };
  callbacks.on_depth = [picture, &out](const WatchedDepth& p, const PictureArrival& a) {
    picture(p.header, a);
    if (out.dump) out.dump->Depth(p);
    if (out.window) out.window->SetDepth(p);
  };
  callbacks.on_mesh = [&out](const WatchMesh& mesh) {
    if (out.meshes) out.meshes->Mesh(mesh);
  };
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

// Until the time is over, the client has ended or somebody interrupts or closes the window; SIGINT and
// SIGTERM are blocked in every thread.
void WaitAndPrint(const Options& options, Watched& watched, PictureWindow* window,
                  const std::atomic<bool>& ended, const sigset_t& signals) {
  // A window must look at its keys more often.
  const std::int64_t look_every_us = window != nullptr ? 10'000 : 100'000;
  const std::int64_t start_us = MonotonicMicros();
  std::int64_t next_print_us = start_us + 1'000'000;
  while (!ended) {
    if (window != nullptr && window->Step() == PictureWindow::State::kClosed) return;
    const std::int64_t now_us = MonotonicMicros();
    std::int64_t wake_us = std::min(next_print_us, now_us + look_every_us);
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

  const auto report_error = [](const Error& error) {
    std::cerr << "mixstage-view: " << error.message << "\n";
    return ExitCode(error);
  };
  const Result<std::string> token = ReadToken(options.token_file);
  if (!token) return report_error(token.error());
  Outputs out;
  if (options.window) {
    auto window = PictureWindow::Create("mixstage-view " + options.url + "   d: depth   q: close");
    if (!window) return report_error(window.error());
    out.window = std::move(*window);
  }
  Watched watched(MonotonicMicros());
  const Result<std::unique_ptr<WatchClient>> client =
      WatchClient::Create({.url = options.url,
                           .token = *token,
                           .ca_file = options.ca_file,
                           .tls_check = options.insecure ? TlsCheck::kNone : TlsCheck::kCertificate,
                           .streams = {.color = true, .depth = true, .mesh = !options.dump.empty()}},
                          Callbacks(watched, out));
  if (!client) return report_error(client.error());
  if (!options.dump.empty()) {
    auto dump = PictureDump::Create(options.dump);
    if (!dump) return report_error(dump.error());
    out.dump = std::move(*dump);
    auto meshes = MeshDump::Create(options.dump);
    if (!meshes) return report_error(meshes.error());
    out.meshes = std::move(*meshes);
  }
  WatchEnd end = WatchEnd::kStopped;
  {
    std::atomic<bool> ended = false;
    const std::jthread thread([&](const std::stop_token& stop) {
      end = (*client)->Run(stop);
      ended = true;
    });
    WaitAndPrint(options, watched, out.window.get(), ended, signals);
  }
  if (out.dump) {
    const RecordingStatus dumped = out.dump->Finish();
    const MeshDump::Counts meshes = out.meshes->Finish();
    std::cerr << "dumped " << dumped.pictures << " pictures and " << meshes.written << " meshes to "
              << options.dump << ", left out " << dumped.dropped + meshes.left_out << "\n";
  }
  const ViewReport report = watched.measure.Total();
  std::cout << ToJsonLine(report) << std::endl;
  if (report.frames > 0 && end == WatchEnd::kStopped) return 0;
  std::cerr << "mixstage-view: "
            << (report.frames > 0 ? "the watching ended: " : "no picture came from " + options.url + ": ")
            << (watched.disconnected.empty() ? watched.server_says : watched.disconnected) << "\n";
  return end == WatchEnd::kLoginRefused ? kLoginRefused : kNoPicture;
}

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  mixstage::Options options;
  CLI::App app("Watches a MixStage server: decodes colour and depth, measures, shows or keeps what comes.",
               "mixstage-view");
  app.footer(mixstage::kFooter);
  app.set_version_flag("--version", std::string("mixstage-view ") + mixstage::kVersion);
  app.add_option("URL", options.url, "the page's address, http://HOST:PORT/ or https://...")->required();
  app.add_option("--seconds", options.seconds, "how long to watch; 0 = until interrupted")
      ->check(CLI::Range(0.0, 1e7))
      ->capture_default_str();
  app.add_flag("--stats", options.stats, "a line every second");
  app.add_flag("--json", options.json, "JSON instead of sentences every second");
  app.add_flag("--window", options.window, "show the pictures; keys: d depth beside them, q or Esc close");
  app.add_option("--dump", options.dump,
                 "keep the pictures in this new folder: rgb/*.png, depth/*.png (16 bit, mm), "
                 "mesh/*.drc with textures, lists of times");
  app.add_option("--token", options.token_file, "file that holds the login's token; - = standard input");
  app.add_option("--ca", options.ca_file, "https: certificates to trust (PEM) instead of the system's");
  app.add_flag("--insecure", options.insecure,
               "https: trust any certificate (whoever is between reads along)");
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
