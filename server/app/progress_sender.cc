// SPDX-License-Identifier: Apache-2.0
#include "server/app/progress_sender.h"

#include <chrono>
#include <utility>

#include "proto/link/epoch.h"

namespace mixstage {
namespace {

constexpr auto kPeriod = std::chrono::milliseconds(500);
constexpr int kLastTimes = 3;
constexpr auto kLastPause = std::chrono::milliseconds(100);  // longer than a burst of loss

}  // namespace

ProgressSender::ProgressSender(SendFunction send, ScanProgress first)
    : send_(std::move(send)),
      epoch_(RandomEpoch()),
      progress_(std::move(first)),
      thread_([this](const std::stop_token& stop) { Run(stop); }) {}

ProgressSender::~ProgressSender() {
  thread_.request_stop();
  thread_.join();
}

void ProgressSender::Say(ScanProgress progress) {
  {
    const std::lock_guard lock(mutex_);
    progress_ = std::move(progress);
    news_ = true;
  }
  changed_.notify_one();
}

ScanProgress ProgressSender::said() const {
  const std::lock_guard lock(mutex_);
  return progress_;
}

void ProgressSender::Run(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    {
      std::unique_lock lock(mutex_);
      changed_.wait_for(lock, stop, kPeriod, [this] { return news_; });
      news_ = false;
    }
    if (!stop.stop_requested()) Send();
  }
  for (int i = 0; i < kLastTimes; ++i) {
    if (i > 0) std::this_thread::sleep_for(kLastPause);
    Send();
  }
}

void ProgressSender::Send() {
  mixstage_lcm::scan_progress_t message = ToMessage(said());
  message.epoch = epoch_;
  message.sequence = sequence_++;
  send_(message);
}

}  // namespace mixstage
