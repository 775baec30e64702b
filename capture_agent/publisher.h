// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "capture_agent/sources/source.h"
#include "proto/codec/depth_codec.h"
#include "proto/codec/jpeg.h"
#include "proto/link/lcm_link.h"

namespace mixstage {

struct PublisherConfig {
  std::string name = "head-1";  // for people; at most 31 bytes are sent
  int jpeg_quality = 90;        // of pictures that are not JPEG yet
  // Datagrams leave in bursts of this many with a pause between them, so that a receiver with a small socket
  // buffer and a switch with small queues keep up; 160 slices (200 kB) take 4 ms.
  int burst_slices = 32;
  int burst_pause_us = 1000;
  double parity = kDefaultParity;  // 0 .. 1, share of the data slices, until SetParity
};

// Encodes what a source captured and hands it to the network: pictures as slices, angles, and health once a
// second. Owned by the publishing thread; never waits for a server.
class Publisher {
 public:
  // epoch: random number of this start, not 0.
  Publisher(const PublisherConfig& config, LcmLink& link, std::int64_t epoch);

  void Publish(const Captured& captured);
  // What the capture side knows of the agent's health.
  struct CaptureHealth {
    std::int64_t dropped = 0;  // pictures, since the start
    int queue = 0;             // pictures that wait
    bool recording = false;
  };
  // Sends agent_health_t when a second has passed.
  void PublishHealthIfDue(const CaptureHealth& capture);
  // A picture that was dropped before it got here still has its number, so that the server can count it as
  // lost.
  void SkipPicture(Stream stream);
  // Parity of the pictures from now on, 0 .. 1.
  void SetParity(double parity) { parity_ = parity; }

  [[nodiscard]] std::int64_t published() const { return published_; }
  [[nodiscard]] std::int64_t send_errors() const { return send_errors_; }

 private:
  void PublishPicture(const CapturedPicture& picture, std::int64_t t_us);

  const PublisherConfig config_;
  LcmLink& link_;
  const std::int64_t epoch_;
  double parity_;
  JpegEncoder jpeg_;
  DepthEncoder depth_;
  EncodedFrame frame_;
  std::array<std::int64_t, 5> sequence_{};          // by stream: number of the next picture
  std::array<std::int64_t, 5> sent_this_second_{};  // by stream
  std::int64_t published_ = 0, send_errors_ = 0, encode_us_ = 0;
  std::int64_t health_due_us_ = 0, last_health_us_ = 0;
};

}  // namespace mixstage
