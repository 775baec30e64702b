// SPDX-License-Identifier: Apache-2.0
//
// A viewer in C++: connects to a server's /watch (SPEC.md 4), decodes both streams, keeps the server's clock,
// and comes back after the server did: also through TLS and a login.
//
//   Result<std::unique_ptr<WatchClient>> client = WatchClient::Create(
//       {.url = "http://localhost:8090/"},
//       {.on_depth = [](const WatchedDepth& picture, const PictureArrival&) { Use(picture.depth_m); }});
//   if (client) (*client)->Run(stop_token);   // blocks until stop is requested or the login refused
//
// In a CMake project: find_package(MixStageClient), link MixStage::client. Warnings go to spdlog's default
// logger; no exception leaves the library.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "proto/base/result.h"
#include "proto/watch/mesh_message.h"
#include "proto/watch/text_message.h"
#include "viewer_client/native/stream_decoder.h"

namespace mixstage {

enum class TlsCheck {
  kCertificate = 1,  // signed by an authority that is trusted, and for this host
  kNone,             // any: whoever is between reads along
};

struct WatchClientConfig {
  std::string url{};      // http[s]://HOST[:PORT][/...] or ws[s]://...: the page's address will do
  std::string token{};    // of the login (SPEC.md 4.4): 43 characters of base64url; empty = none
  std::string ca_file{};  // PEM of the authorities to trust; empty = the system's
  TlsCheck tls_check = TlsCheck::kCertificate;
  WatchSubscribe streams{.color = true, .depth = true};  // meshes only where they are asked for
  double connect_timeout_s = 5;                          // 0.1 .. 60
  double silence_timeout_s = 10;     // nothing from the server for so long: connect again. 1 .. 600
  double shortest_backoff_s = 0.25;  // before the first new attempt; doubles up to longest_backoff_s
  double longest_backoff_s = 4;
};

struct PictureArrival {
  // The server's clock when the picture was decoded; nothing before the first answered ping. Minus
  // header.capture_us it is the latency.
  std::optional<std::int64_t> decoded_server_us{};
  std::size_t message_bytes = 0;
};

// All are called on the thread that is in Run(); any may be empty.
struct WatchCallbacks {
  std::function<void(const ColorPicture&, const PictureArrival&)> on_color{};
  std::function<void(const WatchedDepth&, const PictureArrival&)> on_depth{};
  std::function<void(const WatchMesh&)> on_mesh{};  // checked, not decoded; a view, until it returns
  std::function<void(const WatchHello&)> on_hello{};
  std::function<void(const WatchStats&)> on_stats{};
  // A message that was refused (WatchRefusal) or could not be decoded; a key frame is asked for.
  std::function<void(WatchStream)> on_undecodable{};
  std::function<void()> on_connected{};                           // the server has let us in and speaks
  std::function<void(const std::string& why)> on_disconnected{};  // also an attempt that failed
};

enum class WatchEnd {
  kStopped = 1,
  kLoginRefused,  // the server asks for a token and has none like ours; trying again would not help
};

class WatchClient {
 public:
  // Fails with kInvalidConfig on a URL that cannot be watched, values out of range, a CA file that cannot be
  // read, and a token that would travel to another machine without TLS.
  static Result<std::unique_ptr<WatchClient>> Create(WatchClientConfig config, WatchCallbacks callbacks);
  virtual ~WatchClient() = default;

  // Connects, logs in and reads, again and again, until `stop` is requested or the login refused. Each
  // connection has a ticket of its own. One call at a time.
  virtual WatchEnd Run(std::stop_token stop) = 0;

 protected:
  WatchClient() = default;
};

}  // namespace mixstage
