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
#include "proto/link/lcm_link.h"
#include "server/ingest/live_ingest.h"
#include "server/pipeline/broadcast.h"
#include "server/pipeline/director.h"
#include "server/pipeline/studio.h"

namespace mixstage {

// The running show: one owner thread for each piece of state, newest wins between them.
//   ingest   LcmLink, LiveIngest          -> queue of captured frames
//   frame    Studio (all frame stages)    -> queue of finished frames
//   encode   Broadcast (H.264, delivery)  -> Gateway, which owns "serve"
//   director Director (the scene while it is edited), its own thread
//   stats    twice a second: statistics to the viewers
class LiveShow {
 public:
  // `gateway` must have been started. The show starts at once.
  // `director` may be null: nobody edits the scene.
  LiveShow(std::unique_ptr<LcmLink> link, Studio studio, Broadcast broadcast, Gateway& gateway,
           Director* director);
  ~LiveShow();  // stops: closes every queue, then joins
  LiveShow(const LiveShow&) = delete;
  LiveShow& operator=(const LiveShow&) = delete;

  // Prometheus text; any thread.
  [[nodiscard]] std::string MetricsText() const;
  // What was wrong when a thread had to give up; empty while the show runs.
  [[nodiscard]] std::string failure() const;

 private:
  void RunIngest(const std::stop_token& stop);
  void RunFrames();
  void RunEncode();
  void RunStats(const std::stop_token& stop);
  [[nodiscard]] WatchStats Stats() const;
  void CountDrop(const char* reason);

  std::unique_ptr<LcmLink> link_;
  Studio studio_;
  Broadcast broadcast_;
  Gateway& gateway_;
  Director* director_;

  // Two places: one hiccup of the machine costs latency, not a picture; a server that is too slow drops all
  // the same.
  static constexpr std::size_t kWaitingFrames = 2;
  CapturedFrames captured_{kWaitingFrames, WhenFull::kDropOldest};
  BoundedQueue<std::shared_ptr<Frame>> finished_{kWaitingFrames, WhenFull::kDropOldest};
  LiveIngest ingest_;
  StageTimes times_;

  // A picture that was shown: what statistics over the last seconds are made of.
  struct Shown {
    std::int64_t encoded_us = 0, latency_us = 0, bytes = 0;
  };
  mutable std::mutex mutex_;  // guards what follows
  std::deque<Shown> shown_;   // of the last 10 s
  std::int64_t frames_ = 0, bytes_ = 0;
  std::map<std::string, std::int64_t> drops_;
  RoomState room_state_ = RoomState::kLearning;
  std::uint64_t scene_revision_ = 0;  // of the scene that the last frame showed; 0 = none
  std::string failure_;

  std::jthread ingest_thread_, frame_thread_, encode_thread_, stats_thread_;
};

}  // namespace mixstage
