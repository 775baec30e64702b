// SPDX-License-Identifier: Apache-2.0
//
// Text messages of the viewer stream (SPEC.md 4.2): structs to JSON and back. Reading checks every field that
// it takes: type, size and range; a failure is kBadInput and names the field. Fields that a later version
// adds are skipped. No exception leaves these functions.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "proto/base/result.h"
#include "proto/watch/picture_message.h"
#include "proto/watch/scene_message.h"

namespace mixstage {

inline constexpr int kWatchProtocol = 1;
inline constexpr std::size_t kMaxViewerMessageBytes = 4096;  // viewer to server
// Server to viewer: what a viewer reads at most. A scene of 256 objects with long names fits.
inline constexpr std::size_t kMaxServerMessageBytes = 2 << 20;

// What a viewer may do: watch, or edit the scene too (SPEC.md 4.4).
enum class WatchRole : std::uint8_t { kViewer = 1, kDirector };
[[nodiscard]] std::string_view RoleName(WatchRole role);  // "viewer", "director"
// Fails (kBadInput) on other names.
Result<WatchRole> ParseRole(std::string_view name);

// ---- server to viewer ----
struct WatchStreamInfo {
  WatchStream stream = WatchStream::kColor;
  std::string codec{};  // WebCodecs string, "avc1.42C01F"
  int width = 0, height = 0;
  bool operator==(const WatchStreamInfo&) const = default;
};

// The colour camera without its distortion: pixel = (fx x/z + cx, fy y/z + cy).
struct WatchCamera {
  int width = 0, height = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  // px
  bool operator==(const WatchCamera&) const = default;
};

struct WatchHello {
  std::string name{};  // of the show
  std::int64_t server_us = 0;
  WatchRole role = WatchRole::kViewer;
  std::vector<WatchStreamInfo> streams{};  // empty until a first picture came
  std::optional<WatchCamera> camera{};     // nothing while it is not known
};

struct WatchStage {
  std::string name{};
  double budget_ms = 0, wall_ms = 0, cpu_ms = 0;
};

struct WatchAgent {
  std::string epoch{};  // 16 hexadecimal digits
  std::string name{};
  double age_s = 0;  // since its last message
  double color_fps = 0, depth_fps = 0;
  std::uint64_t drops = 0, queue = 0;
  double encode_ms = 0;
  std::uint64_t lost = 0, repaired = 0;
  double slice_loss = 0;   // 0 .. 1, last 10 s
  double delay_ms = 0;     // median time on the way beyond the fastest, last 10 s
  bool recording = false;  // into a take of its own
};

struct WatchRecording {  // the server's own, of what arrives
  bool active = false;
  double seconds = 0;         // length of the running take, or of the last
  std::uint64_t dropped = 0;  // pictures it lacks
};

struct WatchScan {      // a live scan of the room
  std::string state{};  // sweep, compute, done, failed
  double age_s = 0;     // since its last message
  std::uint64_t positions = 0, recorded = 0, left_out = 0;
  // The sweep as the head sees it, row by row from the top, each from the left: a digit a cell, 0 to come,
  // 1 recorded, 2 left out, 3 the head goes or is there; 0 x 0: too many to show.
  int columns = 0, rows = 0;
  std::string cells{};
  std::array<double, 2> pan_deg{}, tilt_deg{};  // of the first column, row and the last
  std::string text{};                           // compute: the step at work; failed: why
  std::string notes{};                          // lines: what was left out and why
  double coverage = 0;                          // done: 0 .. 1 of the swept directions
  std::uint64_t triangles = 0;                  // done
};

// What happened to an object of the scene.
struct WatchContact {
  double age_s = 0;
  std::string event{"touch"};    // touch, rest, problem
  std::string object{}, with{};  // names; with: of a touch
  double impulse_ns = 0;         // of a touch, N s
  std::string text{};            // of a problem: the sentence its author reads
};
inline constexpr std::size_t kMaxStatsContacts = 16;

struct WatchStats {
  std::int64_t server_us = 0;
  std::string state{};    // live, learning, no_agent, stalled, no_depth
  std::string message{};  // the sentence a person reads, empty when live
  double fps = 0;
  std::uint64_t frames = 0;
  int width = 0, height = 0;
  double latency_p50_ms = 0, latency_p99_ms = 0;  // capture to encoded, last 10 s
  double bitrate_bps = 0;
  std::uint64_t viewers = 0;
  std::map<std::string, std::uint64_t> drops{};  // by reason, since the server's start
  std::vector<WatchStage> stages{};
  std::vector<WatchAgent> agents{};
  double depth_age_s = 0;
  std::optional<double>
      depth_clock_ms{};  // added to depth's times by what the show tells; nothing: not known yet
  WatchRecording recording{};
  std::vector<WatchContact> contacts{};  // of the last 10 s, the newest first, at most kMaxStatsContacts
  std::optional<WatchScan> scan{};       // nothing while no scan has been heard of for a minute
  // Where the camera of the last picture stands: rows of a 3 x 4 matrix, metres; nothing before the first.
  std::optional<std::array<double, 12>> T_scene_color{};
};

struct WatchPong {
  double viewer_us = 0;  // as sent (whole numbers up to 2^53 exactly)
  std::int64_t server_us = 0;
};

// Not finite numbers are written as 0, bytes that are no UTF-8 as U+FFFD: what is written can be read.
[[nodiscard]] std::string ToJson(const WatchHello& hello);
[[nodiscard]] std::string ToJson(const WatchStats& stats);
[[nodiscard]] std::string ToJson(const WatchPong& pong);

using ServerMessage = std::variant<WatchHello, WatchStats, WatchPong, WatchScene, WatchRefused>;
// Also fails on a hello of another protocol, more than kMaxServerMessageBytes and types it does not know.
Result<ServerMessage> ParseServerMessage(std::string_view text);

// ---- viewer to server ----
struct WatchPing {
  double viewer_us = 0;
};
struct WatchTicket {
  std::string ticket{};  // 43 characters of base64url, from POST /login
};
struct WatchSubscribe {
  bool color = false, depth = false, mesh = false, light = false;
  bool operator==(const WatchSubscribe&) const = default;
};
struct WatchKeyFrameWish {};

[[nodiscard]] std::string ToJson(const WatchPing& ping);
[[nodiscard]] std::string ToJson(const WatchTicket& ticket);
[[nodiscard]] std::string ToJson(const WatchSubscribe& subscribe);
[[nodiscard]] std::string ToJson(const WatchKeyFrameWish& wish);

using ViewerMessage = std::variant<WatchPing, WatchTicket, WatchSubscribe, WatchKeyFrameWish, WatchEdit>;
// Fails on more than kMaxViewerMessageBytes, bad JSON, unknown types and streams, missing or mistyped fields.
Result<ViewerMessage> ParseViewerMessage(std::string_view text);

}  // namespace mixstage
