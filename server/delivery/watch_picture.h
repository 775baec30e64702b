// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "proto/watch/picture_message.h"

namespace mixstage {

// One encoded picture as it goes to every viewer: the message of SPEC.md 4.1. Written once, then shared.
struct WatchPicture {
  WatchStream stream = WatchStream::kColor;
  bool key_frame = false;
  std::vector<std::uint8_t> message;
};

// Copies the payload (the encoder's buffer) behind its header.
[[nodiscard]] inline std::shared_ptr<const WatchPicture> MakeWatchPicture(
    const WatchHeader& header, std::span<const std::uint8_t> payload) {
  return std::make_shared<const WatchPicture>(
      WatchPicture{header.stream, header.key_frame, WriteWatchPicture(header, payload)});
}

}  // namespace mixstage
