// SPDX-License-Identifier: Apache-2.0
//
// Tells the rig's network how a live scan goes (SPEC.md 2.7), for the page of a show that listens there.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>

#include "proto/link/scan_progress.h"

namespace mixstage {

// Sends what was last said twice a second and at every change, from a thread of its own: steps of the
// computation take longer.
class ProgressSender {
 public:
  using SendFunction = std::function<void(const mixstage_lcm::scan_progress_t&)>;
  // send: called from the thread, and at last from the destructor.
  ProgressSender(SendFunction send, ScanProgress first);
  ~ProgressSender();  // sends the last word three times
  ProgressSender(const ProgressSender&) = delete;
  ProgressSender& operator=(const ProgressSender&) = delete;

  void Say(ScanProgress progress);
  [[nodiscard]] ScanProgress said() const;

 private:
  void Run(const std::stop_token& stop);
  void Send();

  const SendFunction send_;
  std::int64_t epoch_, sequence_ = 0;  // of the thread
  mutable std::mutex mutex_;           // guards what follows
  std::condition_variable_any changed_;
  ScanProgress progress_;
  bool news_ = true;
  std::jthread thread_;
};

}  // namespace mixstage
