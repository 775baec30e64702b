// SPDX-License-Identifier: Apache-2.0
//
// A live sweep of the head (MixIn3D 2.3): sends it from place to place, waits until it rests, and records
// there a colour picture and depth frames into a capture folder that scan reads.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <mixstage_lcm/head_angles_t.hpp>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/codec/depth_codec.h"
#include "proto/codec/jpeg.h"
#include "proto/geometry/rig.h"
#include "proto/geometry/sweep_grid.h"
#include "proto/link/agent_commands.h"
#include "proto/link/frame_slice.h"
#include "proto/link/scan_progress.h"
#include "proto/take/take_writer.h"

namespace mixstage {

// One thread. What comes from the network is checked and never believed further: pictures of other sizes than
// the rig's, angles that are none and other agents than the first that tells its head's angles are passed
// over. now_us: this machine's monotonic clock; the agent's own is only compared with itself.
class SweepRecorder {
 public:
  static constexpr int kDepths = 3;  // depth frames at each position

  // The rig has a depth camera (checked); positions are not empty (checked).
  SweepRecorder(const Rig& rig, std::vector<HeadPosition> positions, TakeWriter writer);

  void OnHead(const mixstage_lcm::head_angles_t& angles, std::int64_t now_us);
  void OnPicture(const EncodedFrame& picture, std::int64_t now_us);

  // What the agent is to be told now; nothing most of the time. Fails with kUnavailable when no agent tells
  // its head's angles or the disk is full, with kBadInput where fewer than two positions could be recorded.
  Result<std::optional<AgentCommand>> Poll(std::int64_t now_us);

  // All positions are recorded or left out. The last command sends the head back to where it was found.
  [[nodiscard]] bool done() const { return done_; }
  [[nodiscard]] int recorded() const { return recorded_; }
  [[nodiscard]] std::int64_t epoch() const { return epoch_; }  // of the agent; 0 = none heard yet
  // What happened since the last call, a line each, for a person.
  std::vector<std::string> TakeNews();
  // The same for a page. It has changed when there is news.
  [[nodiscard]] ScanProgress Progress() const;

 private:
  struct Depth {
    std::int64_t t_us = 0;
    cv::Mat1w range;
  };
  void LayOut();
  void Follow(std::int64_t epoch);
  void StartPosition();
  void ForgetPictures();
  void NoteRest();
  [[nodiscard]] bool HaveAll() const;
  Status WritePosition();
  void LeaveOut(const std::string& reason);
  void Mark(SweepCell cell);
  Result<std::optional<AgentCommand>> NextPosition(std::int64_t now_us);
  [[nodiscard]] AgentCommand Move(const HeadPosition& to) const;

  const Rig rig_;
  const std::vector<HeadPosition> positions_;
  TakeWriter writer_;
  JpegDecoder jpeg_;
  DepthDecoder depth_decoder_;

  std::int64_t epoch_ = 0, heard_us_ = 0, begun_us_ = 0;
  std::optional<HeadPosition> home_;
  std::size_t position_ = 0;
  std::int64_t sent_us_ = 0, first_sent_us_ = 0;  // of this position's command; 0 = not yet
  std::optional<HeadPosition> sent_from_;
  bool done_ = false, amplitude_known_ = false;
  int recorded_ = 0;
  std::int64_t other_sizes_ = 0;

  // Readings of the last kRestUs; on the agent's clock.
  struct Reading {
    std::int64_t t_us = 0;
    HeadPosition at;
  };
  std::deque<Reading> readings_;
  std::optional<std::int64_t> rests_since_us_;
  HeadPosition rest_sum_;
  int rest_count_ = 0;

  struct Color {
    std::int64_t t_us = 0;
    std::vector<std::uint8_t> jpeg;
  };
  std::optional<Color> color_;
  std::deque<Depth> depths_;
  std::map<std::int64_t, cv::Mat1w> amplitudes_;  // by time
  std::int64_t take_us_ = 0;                      // the written take's clock
  std::vector<std::string> news_;

  SweepMap map_;                    // cells: recorded, left out or to come
  std::vector<std::size_t> cells_;  // of each position; empty where the map has none
  int left_out_ = 0;
  std::string notes_;
};

}  // namespace mixstage
