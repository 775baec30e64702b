// SPDX-License-Identifier: Apache-2.0
//
// One TCP port for viewers (SPEC.md 4), plain or TLS: the page, /healthz, /metrics, the login and the
// WebSocket /watch. One thread, "serve", owns every connection; other threads hand it pictures and texts and
// never wait for it.
//
// A picture is encoded once and shared by all viewers. A viewer that does not read fast enough is set back to
// the next key frame, its queue emptied; one that reads nothing for `stall_timeout_s` is closed. Nobody waits
// for it. Meshes go to whoever subscribed to them: of the actor's the newest, of standing ones each once.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "proto/base/bounded_queue.h"
#include "proto/base/result.h"
#include "proto/watch/text_message.h"
#include "server/delivery/tls_certificate.h"
#include "server/delivery/watch_picture.h"
#include "server/delivery/whole_message.h"

namespace mixstage {

// An edit of a director, on its way to whoever owns the scene.
struct ReceivedEdit {
  WatchEdit edit;
  std::uint64_t viewer = 0;  // the connection; none comes twice
  std::string name{};        // the director's
};
inline constexpr std::size_t kMaxWaitingEdits = 256;
using EditQueue = BoundedQueue<ReceivedEdit>;

struct GatewayConfig {
  std::string listen = "127.0.0.1:8090";  // port 0 = any free one; beyond loopback needs token_file and tls
  std::filesystem::path token_file{};     // who may log in; empty = no login, everyone is a director
  std::filesystem::path audit_file{};     // empty = none is written
  TlsFiles tls{};                         // empty = plain
  std::vector<std::string> origins{};     // pages of elsewhere that may watch: "https://studio.example"
  std::vector<std::string> hosts{};  // further names to be called by, beside loopback's and the certificate's
  std::filesystem::path page_folder{};  // the built page; empty = none
  int max_connections = 256;            // all kinds together: 1 .. 10,000
  int max_viewers = 128;                // 1 .. max_connections
  int max_strangers = 64;               // connections of one address that are not viewers: 1 .. 10,000
  int queued_pictures = 16;             // per viewer, both streams: 2 .. 1,000
  int queued_bytes = 4 << 20;           // per viewer
  int send_buffer_bytes = 256 << 10;  // of the socket: modest, so that the queue above sees a stalled viewer
  double messages_per_s = 20;         // per viewer, text and control frames
  double message_burst = 40;
  double edits_per_s = 100;  // per viewer, counted apart: a drag sends one with every picture
  double edit_burst = 200;
  double request_timeout_s = 10;
  double stall_timeout_s = 10;
  double login_timeout_s = 5;          // for a viewer's ticket
  double idle_timeout_s = 60;          // a viewer that sends nothing for so long is closed
  std::shared_ptr<EditQueue> edits{};  // of kMaxWaitingEdits places; null: there is no scene to edit
};

// What has happened since the start (viewers, connections: now).
struct GatewayCounters {
  std::uint64_t connections = 0, viewers = 0;
  std::uint64_t pictures_sent = 0, bytes_sent = 0;  // of pictures, summed over viewers
  std::uint64_t meshes_sent = 0, mesh_bytes_sent = 0;
  std::uint64_t dropped_viewer_slow = 0;  // pictures that a slow viewer did not get
  std::uint64_t dropped_mesh_slow = 0;    // meshes of the actor that a slow viewer did not get
  std::uint64_t dropped_publish = 0;      // pictures that `serve` did not come to take (a bug's sign)
  std::uint64_t closed_slow = 0, closed_message = 0,
                closed_rate = 0;                       // viewers closed: stalled, bad message, flood
  std::uint64_t closed_login = 0, closed_idle = 0;     // no or a wrong ticket, revoked; silent for too long
  std::uint64_t logins = 0, refused_login = 0;         // POST /login; wrong token or too many attempts
  std::uint64_t refused_origin = 0, refused_full = 0;  // wrong Origin or Host; limits reached
};

class Gateway {
 public:
  // metrics: text of /metrics, called on `serve`: quick, and safe beside the pipeline's threads. May be
  // empty.
  explicit Gateway(GatewayConfig config, std::function<std::string()> metrics = {});
  ~Gateway();  // stops
  Gateway(const Gateway&) = delete;
  Gateway& operator=(const Gateway&) = delete;

  // What Start() would fail with before it opens the port, the page aside.
  static Status Check(const GatewayConfig& config);
  // Reads the page, opens the port and starts `serve`. Once. Fails with kInvalidConfig (a value, tokens,
  // certificate, or an address beyond loopback without both), kBadInput (page folder) or kUnavailable (port
  // in use).
  Status Start();
  // Says goodbye to the viewers (close code 1001), closes everything and joins. Idempotent.
  void Stop();
  // The port that was opened and the page's address, after Start().
  [[nodiscard]] std::uint16_t port() const;
  [[nodiscard]] std::string url() const;

  // ---- Any thread, any time, never blocking ----
  // Pictures of one stream in the order of encoding, none left out between key frames.
  void Publish(std::shared_ptr<const WatchPicture> picture);
  // The actor's mesh and the light map go out once. Meshes of the room and of objects stand: everyone who
  // subscribes gets them, now or later, until they are replaced or removed.
  void PublishWhole(std::shared_ptr<const WholeMessage> message);
  void RemoveMesh(WatchStream stream, std::uint32_t id);
  // A `stats` message (ToJson(WatchStats)); its `state` is what /healthz says.
  void PublishStats(std::string stats_json);
  // A `scene` message: sent to every viewer who comes, after hello, and now to those who are there. A viewer
  // who reads slowly gets the newest.
  void PublishScene(std::string scene_json);
  // A `refused` message to the one viewer who sent the edit, if he is still there.
  void SendTo(std::uint64_t viewer, std::string json);
  // Sent to every viewer who comes, and now to those who are there. server_us is filled in at sending.
  void SetHello(WatchHello hello);
  // True when a viewer waits for a key frame, at most twice a second: the next picture of both streams should
  // be one.
  [[nodiscard]] bool TakeKeyFrameRequest();
  // Whether any viewer has subscribed to the stream (to meshes: any of their streams): if not, encoding can
  // be left out.
  [[nodiscard]] bool WantsStream(WatchStream stream) const;
  [[nodiscard]] GatewayCounters counters() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mixstage
