// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <string>
#include <utility>

namespace mixstage {

// How many connections each network has that are not viewers: one that only opens connections cannot take
// every place. One thread.
class StrangerCounts {
 public:
  [[nodiscard]] int Of(const std::string& network) const {
    const auto found = counts_.find(network);
    return found == counts_.end() ? 0 : found->second;
  }
  void Add(const std::string& network) { ++counts_[network]; }
  void Remove(const std::string& network) {
    if (const auto found = counts_.find(network); --found->second == 0) counts_.erase(found);
  }

 private:
  std::map<std::string, int> counts_;  // no more entries than connections
};

// One of the connections that are counted; gives its place back when it dies.
class ConnectionSlot {
 public:
  ConnectionSlot(std::atomic<std::uint64_t>& count, StrangerCounts& strangers, std::string network)
      : count_(&count), strangers_(&strangers), network_(std::move(network)) {
    ++*count_;
    strangers_->Add(network_);
  }
  ConnectionSlot(ConnectionSlot&& other) noexcept
      : count_(std::exchange(other.count_, nullptr)),
        strangers_(std::exchange(other.strangers_, nullptr)),
        network_(std::move(other.network_)) {}
  ConnectionSlot& operator=(ConnectionSlot&&) = delete;
  ~ConnectionSlot() {
    NoStranger();
    if (count_ != nullptr) --*count_;
  }
  // It is a viewer from here on.
  void NoStranger() {
    if (auto* strangers = std::exchange(strangers_, nullptr)) strangers->Remove(network_);
  }

 private:
  std::atomic<std::uint64_t>* count_;
  StrangerCounts* strangers_;
  std::string network_;
};

}  // namespace mixstage
