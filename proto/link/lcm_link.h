// SPDX-License-Identifier: Apache-2.0
//
// The one place that knows liblcm. Everything behind the datagram is ours (frame_slice.h, reassembler.h).
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mixstage_lcm/agent_command_t.hpp>
#include <mixstage_lcm/agent_health_t.hpp>
#include <mixstage_lcm/frame_slice_t.hpp>
#include <mixstage_lcm/head_angles_t.hpp>
#include <mixstage_lcm/scan_progress_t.hpp>
#include <mixstage_lcm/scene_event_t.hpp>
#include <string>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

// Multicast on this host only (ttl 0), with room for a burst of two seconds of pictures. "memq://" stays
// inside the process (tests).
inline constexpr const char* kDefaultLcmUrl = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304";

class LcmLink {
 public:
  // Fails (kUnavailable) when the URL is wrong or the machine has no multicast route; the message names the
  // fix.
  static Result<std::unique_ptr<LcmLink>> Create(const std::string& url);
  ~LcmLink();
  LcmLink(const LcmLink&) = delete;
  LcmLink& operator=(const LcmLink&) = delete;

  // Publishing: any thread. False when the socket refused the datagram (the caller counts it).
  bool Publish(const mixstage_lcm::frame_slice_t& slice);
  bool Publish(const mixstage_lcm::head_angles_t& angles);
  bool Publish(const mixstage_lcm::agent_health_t& health);
  bool Publish(const mixstage_lcm::agent_command_t& command);
  bool Publish(const mixstage_lcm::scan_progress_t& progress);
  bool Publish(const mixstage_lcm::scene_event_t& event);

  // Receiving: one thread, which may be another than the publishing one, sets the handlers and then calls
  // HandleFor in a loop. A channel without a handler is not listened to. Messages that LCM cannot decode
  // (wrong type or length) are counted, not handed over.
  struct Handlers {
    std::function<void(const mixstage_lcm::frame_slice_t&)> on_slice{};
    std::function<void(const mixstage_lcm::head_angles_t&)> on_head{};
    std::function<void(const mixstage_lcm::agent_health_t&)> on_health{};
    std::function<void(const mixstage_lcm::agent_command_t&)> on_command{};
    std::function<void(const mixstage_lcm::scan_progress_t&)> on_scan{};
    std::function<void(const mixstage_lcm::scene_event_t&)> on_event{};
  };
  void Subscribe(Handlers handlers);
  // Waits up to `timeout_ms` for messages and hands over all that are there.
  void HandleFor(int timeout_ms);
  [[nodiscard]] std::int64_t undecodable() const;

  // Sends itself a message and waits for it; fails with what to do when none comes. Returns warnings (a
  // receive buffer that the kernel cut) otherwise. Before Subscribe.
  Result<std::vector<std::string>> SelfTest();

 private:
  LcmLink() = default;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace mixstage
