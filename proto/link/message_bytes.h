// SPDX-License-Identifier: Apache-2.0
//
// Our messages as the bytes of one datagram and back. Every type of proto/lcm has a fixed size: only exactly
// that is decoded.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "proto/base/check.h"

namespace mixstage {

class MessageBytes {
 public:
  template <typename Message>
  explicit MessageBytes(const Message& message) : size_(message.getEncodedSize()) {
    MIX_CHECK(size_ <= static_cast<int>(bytes_.size()) && message.encode(bytes_.data(), 0, size_) == size_);
  }
  [[nodiscard]] const std::uint8_t* data() const { return bytes_.data(); }
  [[nodiscard]] std::size_t size() const { return static_cast<std::size_t>(size_); }

 private:
  std::array<std::uint8_t, 1400> bytes_;
  int size_;
};

// False when the bytes are no message of this type: another length or fingerprint.
template <typename Message>
[[nodiscard]] bool DecodeMessage(std::span<const std::uint8_t> bytes, Message& message) {
  const int size = message.getEncodedSize();
  return bytes.size() == static_cast<std::size_t>(size) && message.decode(bytes.data(), 0, size) == size;
}

}  // namespace mixstage
