// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <utility>

#include "proto/base/check.h"

namespace mixstage {

enum class WhenFull {
  kDropOldest = 1,  // live data: the newest matters
  kWait,            // offline work: nothing is lost, the producer waits
};

// First in, first out, never longer than its capacity. Any thread; Close() wakes both ends; what is queued
// can still be taken after it.
template <typename T>
class BoundedQueue {
 public:
  BoundedQueue(std::size_t capacity, WhenFull when_full) : capacity_(capacity), when_full_(when_full) {
    MIX_CHECK(capacity > 0);
  }
  // Returns the number of values dropped to make room (0 or 1; a closed queue takes nothing and drops it).
  int Push(T value) {
    int dropped = 0;
    {
      std::unique_lock lock(mutex_);
      if (when_full_ == WhenFull::kWait) {
        space_.wait(lock, [&] { return items_.size() < capacity_ || closed_; });
      }
      if (closed_) return 1;
      if (items_.size() >= capacity_) {
        items_.pop_front();
        dropped = 1;
      }
      items_.push_back(std::move(value));
    }
    ready_.notify_one();
    return dropped;
  }
  // Waits for a value; nothing once closed and empty.
  std::optional<T> Pop() {
    std::unique_lock lock(mutex_);
    ready_.wait(lock, [&] { return !items_.empty() || closed_; });
    return PopLocked();
  }
  // Waits no longer than that.
  std::optional<T> PopFor(std::chrono::milliseconds limit) {
    std::unique_lock lock(mutex_);
    ready_.wait_for(lock, limit, [&] { return !items_.empty() || closed_; });
    return PopLocked();
  }
  std::optional<T> TryPop() {
    const std::lock_guard lock(mutex_);
    return PopLocked();
  }
  std::size_t size() const {
    const std::lock_guard lock(mutex_);
    return items_.size();
  }
  void Close() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
    }
    ready_.notify_all();
    space_.notify_all();
  }

 private:
  std::optional<T> PopLocked() {
    if (items_.empty()) return std::nullopt;
    std::optional<T> value(std::move(items_.front()));
    items_.pop_front();
    space_.notify_one();
    return value;
  }

  const std::size_t capacity_;
  const WhenFull when_full_;
  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::condition_variable space_;
  std::deque<T> items_;
  bool closed_ = false;
};

}  // namespace mixstage
