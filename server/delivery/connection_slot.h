// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <utility>

namespace mixstage {

// One of the connections that are counted; gives its place back when it dies.
class ConnectionSlot {
 public:
  explicit ConnectionSlot(std::atomic<std::uint64_t>& count) : count_(&count) { ++*count_; }
  ConnectionSlot(ConnectionSlot&& other) noexcept : count_(std::exchange(other.count_, nullptr)) {}
  ConnectionSlot& operator=(ConnectionSlot&&) = delete;
  ~ConnectionSlot() {
    if (count_ != nullptr) --*count_;
  }

 private:
  std::atomic<std::uint64_t>* count_;
};

}  // namespace mixstage
