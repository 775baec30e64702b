// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "proto/codec/jpeg.h"
#include "proto/take/take.h"
#include "server/ingest/captured_frame.h"

namespace mixstage {

// The pairing of LiveIngest for a take: colour picture i with the newest depth at or before it.
// Deterministic, any order of calls (two neighbouring frames load their shared depth once). One thread.
class TakeIngest {
 public:
  // The take outlives it.
  TakeIngest(const Take& take, const Rig& rig);

  [[nodiscard]] int frames() const { return static_cast<int>(take_.color.size()); }
  // Fails when the colour picture cannot be used. A depth picture that cannot be used is left out, and said
  // in `warning` (empty otherwise).
  Result<std::shared_ptr<const CapturedFrame>> Load(int index, std::string& warning);

 private:
  Result<std::shared_ptr<const DepthPicture>> LoadDepth(std::size_t index);

  const Take& take_;
  const Rig rig_;
  JpegDecoder jpeg_;
  std::size_t loaded_index_ = 0;
  std::shared_ptr<const DepthPicture> loaded_;
};

}  // namespace mixstage
