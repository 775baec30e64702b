// SPDX-License-Identifier: Apache-2.0
#include "capture_agent/publisher.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <thread>

#include "proto/base/clock.h"
#include "proto/base/log.h"

namespace mixstage {
namespace {

constexpr std::int64_t kHealthPeriodUs = 1'000'000;

std::size_t Index(Stream stream) { return static_cast<std::size_t>(stream); }

}  // namespace

Publisher::Publisher(const PublisherConfig& config, LcmLink& link, std::int64_t epoch)
    : config_(config),
      link_(link),
      epoch_(epoch),
      parity_(config.parity),
      last_health_us_(MonotonicMicros()) {}

void Publisher::Publish(const Captured& captured) {
  if (const auto* angles = std::get_if<CapturedAngles>(&captured.what)) {
    mixstage_lcm::head_angles_t message{};
    message.epoch = epoch_;
    message.t_us = captured.t_us;
    message.pan_deg = angles->pan_deg;
    message.tilt_deg = angles->tilt_deg;
    send_errors_ += !link_.Publish(message);
    return;
  }
  PublishPicture(std::get<CapturedPicture>(captured.what), captured.t_us);
}

void Publisher::SkipPicture(Stream stream) { ++sequence_[Index(stream)]; }

void Publisher::PublishPicture(const CapturedPicture& picture, std::int64_t t_us) {
  const std::int64_t cpu_start_us = ThreadCpuMicros();
  frame_.epoch = epoch_;
  frame_.t_us = t_us;
  frame_.sequence = sequence_[Index(picture.stream)]++;
  frame_.stream = picture.stream;
  frame_.width = picture.width;
  frame_.height = picture.height;
  frame_.encoding = Encoding::kJpeg;
  if (const auto* bytes = std::get_if<std::vector<std::uint8_t>>(&picture.content)) {
    frame_.bytes = *bytes;
  } else if (const auto* planes = std::get_if<YuvImage>(&picture.content)) {
    if (auto ok = jpeg_.Encode(*planes, config_.jpeg_quality, frame_.bytes); !ok) {
      spdlog::warn("publisher dropped=1 reason=\"{}\"", ok.error().message);
      return;
    }
  } else {
    frame_.encoding = Encoding::kDepth16;
    depth_.Encode(View(std::get<cv::Mat1w>(picture.content)), frame_.bytes);
  }
  if (picture.stream == Stream::kColor) encode_us_ += ThreadCpuMicros() - cpu_start_us;
  if (frame_.bytes.empty() || frame_.bytes.size() > static_cast<std::size_t>(kMaxFrameBytes)) {
    spdlog::warn("publisher dropped=1 reason=\"picture of {} bytes\"", frame_.bytes.size());
    return;
  }
  int in_burst = 0;
  auto send = [&](const mixstage_lcm::frame_slice_t& slice) {
    if (in_burst++ == config_.burst_slices) {
      std::this_thread::sleep_for(std::chrono::microseconds(config_.burst_pause_us));
      in_burst = 1;
    }
    send_errors_ += !link_.Publish(slice);
  };
  CutIntoSlices(frame_, send, parity_);
  ++published_;
  ++sent_this_second_[Index(picture.stream)];
}

void Publisher::PublishHealthIfDue(const CaptureHealth& capture) {
  const std::int64_t now_us = MonotonicMicros();
  if (now_us < health_due_us_) return;
  health_due_us_ = now_us + kHealthPeriodUs;
  const double seconds = std::max(1e-3, static_cast<double>(now_us - last_health_us_) * 1e-6);
  last_health_us_ = now_us;
  mixstage_lcm::agent_health_t health{};
  health.epoch = epoch_;
  health.t_us = now_us;
  std::memcpy(health.name, config_.name.data(), std::min(config_.name.size(), sizeof health.name - 1));
  auto rate = [&](Stream stream) {
    return static_cast<float>(static_cast<double>(sent_this_second_[Index(stream)]) / seconds);
  };
  health.color_fps = rate(Stream::kColor);
  health.depth_fps = rate(Stream::kDepth);
  health.fisheye_fps = rate(Stream::kFisheye);
  const std::int64_t pictures = std::max<std::int64_t>(1, sent_this_second_[Index(Stream::kColor)]);
  health.encode_ms =
      static_cast<float>(static_cast<double>(encode_us_) * 1e-3 / static_cast<double>(pictures));
  health.queue = capture.queue;
  health.published = published_;
  health.dropped = capture.dropped;
  health.send_errors = send_errors_;
  health.recording = capture.recording ? 1 : 0;
  send_errors_ += !link_.Publish(health);
  sent_this_second_.fill(0);
  encode_us_ = 0;
}

}  // namespace mixstage
