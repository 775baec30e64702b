// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <optional>
#include <utility>

namespace mixstage {

// One place for one value: newest wins. What live threads hand frames over with: a slow reader sees the
// newest frame, never a backlog. Any thread; Close() wakes the reader for good.
template <typename T>
class Mailbox {
 public:
  // Returns true when a value that nobody had taken was replaced (a drop the caller counts).
  bool Put(T value) {
    bool replaced = false;
    {
      const std::lock_guard lock(mutex_);
      if (closed_) return false;
      replaced = value_.has_value();
      value_ = std::move(value);
    }
    ready_.notify_one();
    return replaced;
  }
  // Waits for a value; nothing once closed and empty.
  std::optional<T> Take() {
    std::unique_lock lock(mutex_);
    ready_.wait(lock, [&] { return value_.has_value() || closed_; });
    return std::exchange(value_, std::nullopt);
  }
  // Same, but gives up after `timeout`.
  template <typename Duration>
  std::optional<T> TakeFor(Duration timeout) {
    std::unique_lock lock(mutex_);
    ready_.wait_for(lock, timeout, [&] { return value_.has_value() || closed_; });
    return std::exchange(value_, std::nullopt);
  }
  void Close() {
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
    }
    ready_.notify_all();
  }
  bool closed() const {
    const std::lock_guard lock(mutex_);
    return closed_;
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable ready_;
  std::optional<T> value_;
  bool closed_ = false;
};

}  // namespace mixstage
