// SPDX-License-Identifier: Apache-2.0
#include "proto/link/lcm_link.h"

#include <lcm/lcm.h>

#include <cstdlib>
#include <cstring>
#include <fstream>
#include <random>

#include "proto/base/clock.h"
#include "proto/link/message_bytes.h"

namespace mixstage {
namespace {

constexpr const char* kSliceChannel = "MIXSTAGE_SLICE";
constexpr const char* kHeadChannel = "MIXSTAGE_HEAD";
constexpr const char* kHealthChannel = "MIXSTAGE_HEALTH";
constexpr const char* kCommandChannel = "MIXSTAGE_COMMAND";
constexpr const char* kScanChannel = "MIXSTAGE_SCAN";
constexpr const char* kEventChannel = "MIXSTAGE_EVENT";
constexpr const char* kSelfTestChannel = "MIXSTAGE_SELF_TEST";
constexpr int kSelfTestTimeoutMs = 1000;
constexpr int kMaxMessagesPerWait = 4096;  // so that a flood cannot keep HandleFor from returning
constexpr const char* kRouteFix =
    "give multicast a route: ip link set lo up && ip link set lo multicast on && ip route add 224.0.0.0/4 "
    "dev lo";

// The receive buffer that the URL asks for; 0 when it asks for none.
long RequestedReceiveBuffer(const std::string& url) {
  constexpr const char* kKey = "recv_buf_size=";
  const std::size_t at = url.find(kKey);
  return at == std::string::npos ? 0 : std::strtol(url.c_str() + at + std::strlen(kKey), nullptr, 10);
}

template <typename Message>
bool PublishMessage(lcm_t* lcm, const char* channel, const Message& message) {
  const MessageBytes bytes(message);
  return lcm_publish(lcm, channel, bytes.data(), static_cast<unsigned>(bytes.size())) == 0;
}

}  // namespace

struct LcmLink::State {
  std::string url;
  lcm_t* lcm = nullptr;
  Handlers handlers;
  std::int64_t undecodable = 0;
  ~State() {
    if (lcm != nullptr) lcm_destroy(lcm);
  }

  template <typename Message>
  void Receive(const lcm_recv_buf_t& buffer, const std::function<void(const Message&)>& handler) {
    Message message{};
    if (!DecodeMessage({static_cast<const std::uint8_t*>(buffer.data), buffer.data_size}, message)) {
      ++undecodable;
      return;
    }
    handler(message);
  }

  // Listens to a channel where there is somebody to hear it.
  template <typename Message, std::function<void(const Message&)> Handlers::*kHandler>
  lcm_subscription_t* Listen(const char* channel) {
    if (!(handlers.*kHandler)) return nullptr;
    return lcm_subscribe(
        lcm, channel,
        [](const lcm_recv_buf_t* b, const char*, void* user) {
          auto& state = *static_cast<State*>(user);
          state.Receive(*b, state.handlers.*kHandler);
        },
        this);
  }
};

Result<std::unique_ptr<LcmLink>> LcmLink::Create(const std::string& url) {
  auto link = std::unique_ptr<LcmLink>(new LcmLink);
  link->state_ = std::make_unique<State>();
  link->state_->url = url;
  link->state_->lcm = lcm_create(url.c_str());
  if (link->state_->lcm == nullptr) {
    return Fail(ErrorCode::kUnavailable, "LCM cannot open " + url + ": " + kRouteFix);
  }
  return link;
}

LcmLink::~LcmLink() = default;

bool LcmLink::Publish(const mixstage_lcm::frame_slice_t& m) {
  return PublishMessage(state_->lcm, kSliceChannel, m);
}
bool LcmLink::Publish(const mixstage_lcm::head_angles_t& m) {
  return PublishMessage(state_->lcm, kHeadChannel, m);
}
bool LcmLink::Publish(const mixstage_lcm::agent_health_t& m) {
  return PublishMessage(state_->lcm, kHealthChannel, m);
}
bool LcmLink::Publish(const mixstage_lcm::agent_command_t& m) {
  return PublishMessage(state_->lcm, kCommandChannel, m);
}
bool LcmLink::Publish(const mixstage_lcm::scan_progress_t& m) {
  return PublishMessage(state_->lcm, kScanChannel, m);
}
bool LcmLink::Publish(const mixstage_lcm::scene_event_t& m) {
  return PublishMessage(state_->lcm, kEventChannel, m);
}

void LcmLink::Subscribe(Handlers handlers) {
  State& s = *state_;
  s.handlers = std::move(handlers);
  // The default queue of 30 messages is less than one picture.
  if (auto* slices = s.Listen<mixstage_lcm::frame_slice_t, &Handlers::on_slice>(kSliceChannel))
    lcm_subscription_set_queue_capacity(slices, 8192);
  s.Listen<mixstage_lcm::head_angles_t, &Handlers::on_head>(kHeadChannel);
  s.Listen<mixstage_lcm::agent_health_t, &Handlers::on_health>(kHealthChannel);
  s.Listen<mixstage_lcm::agent_command_t, &Handlers::on_command>(kCommandChannel);
  s.Listen<mixstage_lcm::scan_progress_t, &Handlers::on_scan>(kScanChannel);
  s.Listen<mixstage_lcm::scene_event_t, &Handlers::on_event>(kEventChannel);
}

void LcmLink::HandleFor(int timeout_ms) {
  if (lcm_handle_timeout(state_->lcm, timeout_ms) <= 0) return;
  for (int i = 0; i < kMaxMessagesPerWait && lcm_handle_timeout(state_->lcm, 0) > 0; ++i) {
  }
}

std::int64_t LcmLink::undecodable() const { return state_->undecodable; }

Result<std::vector<std::string>> LcmLink::SelfTest() {
  State& s = *state_;
  struct Echo {
    std::uint64_t nonce;
    bool heard = false;
  } echo{(std::uint64_t{std::random_device{}()} << 32) | std::random_device{}()};
  lcm_subscription_t* subscription = lcm_subscribe(
      s.lcm, kSelfTestChannel,
      [](const lcm_recv_buf_t* b, const char*, void* user) {
        auto& e = *static_cast<Echo*>(user);
        std::uint64_t nonce = 0;
        if (b->data_size == sizeof nonce) std::memcpy(&nonce, b->data, sizeof nonce);
        e.heard = e.heard || nonce == e.nonce;
      },
      &echo);
  const std::int64_t deadline_us = MonotonicMicros() + kSelfTestTimeoutMs * 1000;
  while (!echo.heard && MonotonicMicros() < deadline_us) {
    lcm_publish(s.lcm, kSelfTestChannel, &echo.nonce, sizeof echo.nonce);
    lcm_handle_timeout(s.lcm, 100);
  }
  lcm_unsubscribe(s.lcm, subscription);
  if (!echo.heard) {
    return Fail(ErrorCode::kUnavailable, "LCM hears nothing of what it sends to " + s.url + ": " + kRouteFix +
                                             "; a firewall must let UDP port 7667 pass");
  }
  std::vector<std::string> warnings;
  const long requested = RequestedReceiveBuffer(s.url);
  long granted_max = 0;
  std::ifstream("/proc/sys/net/core/rmem_max") >> granted_max;
  if (requested > granted_max && granted_max > 0) {
    warnings.push_back(
        "the kernel cuts the receive buffer from " + std::to_string(requested) + " to " +
        std::to_string(granted_max) +
        " bytes, bursts will be lost: sysctl -w net.core.rmem_max=" + std::to_string(requested));
  }
  return warnings;
}

}  // namespace mixstage
