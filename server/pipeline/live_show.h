// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "proto/base/bounded_queue.h"
#include "proto/link/agent_commands.h"
#include "proto/link/lcm_link.h"
#include "server/delivery/osc_sender.h"
#include "server/ingest/live_ingest.h"
#include "server/pipeline/broadcast.h"
#include "server/pipeline/director.h"
#include "server/pipeline/event_sender.h"
#include "server/pipeline/mesh_broadcast.h"
#include "server/pipeline/studio.h"

namespace mixstage {

// What a show is made of.
struct LiveShowParts {
  std::unique_ptr<LcmLink> link;
  Studio studio;
  Broadcast broadcast;
  MeshBroadcast meshes;
  std::unique_ptr<TakeRecorder> recorder{};  // of what arrives; null = none
  std::optional<OscSender> osc{};            // hears of contacts
  Director* director = nullptr;              // borrowed; null = nobody edits the scene
};

// The running show: one owner thread for each piece of state, newest wins between them.
//   ingest   LcmLink, LiveIngest          -> queue of captured frames
//   frame    Studio (all frame stages)    -> queue of finished frames
//   encode   Broadcast (H.264, delivery)  -> Gateway, which owns "serve"
//   mesh     MeshBroadcast (Draco)        -> Gateway; only while a viewer wants meshes
//   director Director (the scene while it is edited), its own thread
//   stats    twice a second: statistics to the viewers
class LiveShow {
 public:
  // `gateway` must have been started. The show starts at once.
  LiveShow(LiveShowParts parts, Gateway& gateway);
  ~LiveShow();  // stops: closes every queue, then joins
  LiveShow(const LiveShow&) = delete;
  LiveShow& operator=(const LiveShow&) = delete;

  // Asks agents for something (SPEC.md 2.5); returns at once, any thread.
  void SendToAgents(AgentCommand command, std::int64_t target_epoch = kEveryAgent);
  // The parity that every agent shall use, 0 .. 1, also those that appear later; any thread.
  void SetAgentParity(double share);

  // Prometheus text; any thread.
  [[nodiscard]] std::string MetricsText() const;
  // The back end in force, for people.
  [[nodiscard]] const std::string& renderer() const { return studio_.renderer(); }
  // What was wrong when a thread had to give up; empty while the show runs.
  [[nodiscard]] std::string failure() const;

 private:
  void RunIngest(const std::stop_token& stop);
  void GreetNewAgents(std::int64_t now_us);
  void RunFrames();
  void RunEncode();
  void RunMeshes();
  void OfferMeshes(const std::shared_ptr<const Frame>& frame);
  void OfferLightMap(const Frame& frame);
  void RunStats(const std::stop_token& stop);
  [[nodiscard]] WatchStats Stats() const;
  void CountDrop(const char* reason);

  std::unique_ptr<LcmLink> link_;
  Studio studio_;
  Broadcast broadcast_;
  MeshBroadcast meshes_;
  Gateway& gateway_;
  const std::unique_ptr<TakeRecorder> recorder_;
  const std::optional<OscSender> osc_;
  Director* const director_;

  // Two places: one hiccup of the machine costs latency, not a picture; a server that is too slow drops all
  // the same.
  static constexpr std::size_t kWaitingFrames = 2;
  CapturedFrames captured_{kWaitingFrames, WhenFull::kDropOldest};
  BoundedQueue<std::shared_ptr<Frame>> finished_{kWaitingFrames, WhenFull::kDropOldest};
  BoundedQueue<MeshJob> mesh_jobs_{1, WhenFull::kDropOldest};
  std::int64_t meshed_us_ = 0;     // capture of the last frame that was offered; the frame thread's
  std::int64_t light_map_us_ = 0;  // the same for light maps
  std::shared_ptr<const DepthPicture> meshed_depth_;
  LiveIngest ingest_;
  CommandSender commands_;
  EventSender events_;                                  // of the frame thread
  std::atomic<int> parity_thousandths_ = -1;            // -1: agents keep their own
  std::int64_t epochs_greeted_ = 0, greet_due_us_ = 0;  // of the ingest thread
  StageTimes times_;

  // A picture that was shown: what statistics over the last seconds are made of.
  struct Shown {
    std::int64_t encoded_us = 0, latency_us = 0, bytes = 0;
  };
  mutable std::mutex mutex_;  // guards what follows
  std::deque<Shown> shown_;   // of the last 10 s
  std::int64_t frames_ = 0, bytes_ = 0;
  std::map<std::string, std::int64_t> drops_;
  std::deque<PhysicsEvent> contacts_;  // the newest first, at most kMaxStatsContacts
  RoomState room_state_ = RoomState::kLearning;
  double nudge_px_ = 0;  // of the camera, the last one
  std::int64_t nudged_us_ = 0;
  std::optional<double> depth_clock_ms_;         // what is added to depth's times
  std::optional<RigidTransform> T_scene_color_;  // of the last frame
  std::uint64_t scene_revision_ = 0;             // of the scene that the last frame showed; 0 = none
  std::string failure_;

  std::jthread ingest_thread_, frame_thread_, encode_thread_, mesh_thread_, stats_thread_;
};

}  // namespace mixstage
