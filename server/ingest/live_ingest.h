// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mixstage_lcm/agent_health_t.hpp>
#include <mixstage_lcm/head_angles_t.hpp>
#include <mixstage_lcm/scan_progress_t.hpp>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/bounded_queue.h"
#include "proto/codec/depth_codec.h"
#include "proto/codec/jpeg.h"
#include "proto/geometry/rig.h"
#include "proto/link/reassembler.h"
#include "proto/link/scan_progress.h"
#include "proto/take/take_recorder.h"
#include "server/ingest/captured_frame.h"
#include "server/ingest/clock_map.h"
#include "server/ingest/delay_window.h"
#include "server/ingest/head_track.h"

namespace mixstage {

// Frames on their way to the frame thread: WhenFull::kDropOldest, so that the newest are shown.
using CapturedFrames = BoundedQueue<std::shared_ptr<const CapturedFrame>>;

// What is known of an agent, for the page and the metrics.
struct AgentStatus {
  std::int64_t epoch = 0;
  std::string name;
  std::int64_t last_heard_us = 0;  // server clock
  float color_fps = 0, depth_fps = 0, fisheye_fps = 0, encode_ms = 0;
  std::int64_t queue = 0, dropped = 0, send_errors = 0, lost = 0;
  std::int64_t repaired = 0;  // pictures that parity made whole
  bool recording = false;     // into a take of its own
  double slice_loss = 0;      // 0 .. 1, share of the slices that did not arrive, last 10 s
  double delay_ms = 0;        // median time on the way beyond the fastest, last 10 s; 0 when not followed
};

// A live scan that was heard of, by its last word.
struct ScanStatus {
  std::int64_t epoch = 0, sequence = 0;
  std::int64_t last_heard_us = 0;  // server clock
  ScanProgress progress{};
};

struct IngestStatus {
  std::map<std::string, std::int64_t> drops;  // by reason, since the start
  std::vector<AgentStatus> agents;
  std::optional<ScanStatus> scan;
  std::int64_t color_pictures = 0, depth_pictures = 0;
  std::int64_t last_color_us = 0, last_depth_us = 0;  // arrival on the server's clock; 0 = never
  double decode_wall_ms = 0, decode_cpu_ms = 0;       // of the last colour picture
};

// Slices to paired frames (DESIGN "Time and frames"): reassembles, decodes, maps clocks, pairs colour with
// the newest depth and puts the frame into the queue, where the newest win. One thread feeds it
// (`ingest`); Status() may be called from any.
//
// One agent is followed: the first whose colour arrives, until it has been silent for kSwitchUs. Pictures of
// another are counted ("other_agent"), so that two agents started by mistake do not cut into each other.
class LiveIngest {
 public:
  static constexpr std::int64_t kSwitchUs = 500'000;
  static constexpr std::int64_t kScanSilentUs = 3'000'000;
  static constexpr std::int64_t kDepthStaleUs =
      1'000'000;  // older depth is no depth: the key goes on by colour

  // recorder: gets every picture of the followed agent that arrived whole and fits the rig, as it came, with
  // the time on the server's clock; null = none.
  LiveIngest(const Rig& rig, CapturedFrames& out, TakeRecorder* recorder = nullptr);

  void OnSlice(const mixstage_lcm::frame_slice_t& slice, std::int64_t now_us);
  void OnHead(const mixstage_lcm::head_angles_t& angles, std::int64_t now_us);
  void OnHealth(const mixstage_lcm::agent_health_t& health, std::int64_t now_us);
  // One scan is followed until it has ended or been silent for kScanSilentUs.
  void OnScan(const mixstage_lcm::scan_progress_t& message, std::int64_t now_us);
  // Now and then, also when nothing comes: releases pictures that waited for older ones, refreshes what is
  // known of the transport.
  void Poll(std::int64_t now_us);

  [[nodiscard]] IngestStatus Status() const;
  // Counts the agents that appeared; of the feeding thread.
  [[nodiscard]] std::int64_t epochs_heard() const { return epochs_heard_; }

 private:
  void TakePictures(std::int64_t now_us);
  void OnPicture(const EncodedFrame& encoded, std::int64_t now_us);
  void OnColor(const EncodedFrame& encoded, std::int64_t now_us);
  void OnDepth(const EncodedFrame& encoded, std::int64_t now_us);
  void PublishTransportCounters(std::int64_t now_us);
  bool Follows(std::int64_t epoch, std::int64_t now_us);
  AgentStatus& Agent(std::int64_t epoch, std::int64_t now_us);
  std::shared_ptr<const DepthPicture> NewestDepthBefore(std::int64_t capture_us) const;
  void Drop(const char* reason, std::int64_t count = 1);

  const Rig rig_;
  CapturedFrames& out_;
  TakeRecorder* const recorder_;
  Reassembler reassembler_;
  std::int64_t transport_due_us_ = 0, epochs_heard_ = 0;
  JpegDecoder jpeg_;
  DepthDecoder depth_decoder_;

  std::int64_t followed_epoch_ = 0, followed_heard_us_ = 0;
  ClockMap clock_;
  DelayWindow delay_;                // of the followed agent's pictures
  std::int64_t next_sequence_ = -1;  // of colour, in the followed epoch
  std::int64_t next_frame_ = 0;
  std::deque<std::shared_ptr<const DepthPicture>> depths_;  // newest at the back
  std::int64_t amplitude_t_us_ = 0;
  cv::Mat1w amplitude_;
  HeadTrack head_;  // agent's clock

  mutable std::mutex mutex_;  // guards status_
  IngestStatus status_;
};

}  // namespace mixstage
