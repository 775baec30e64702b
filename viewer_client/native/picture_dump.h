// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <memory>

#include "proto/base/result.h"
#include "proto/take/take_recorder.h"
#include "viewer_client/native/stream_decoder.h"

namespace mixstage {

// Watched pictures as a take (SPEC.md 5) that any TUM RGB-D tool and `mixstage-server process` read:
// rgb/*.png 8 bit, depth/*.png 16 bit in mm (0 = unknown), lists with the server's capture times. Neither the
// disk nor the packing holds the watching up: pictures that it cannot keep up with are dropped and counted.
class PictureDump {
 public:
  // Fails (kInvalidConfig) where the folder holds a take already or cannot be made.
  static Result<std::unique_ptr<PictureDump>> Create(const std::filesystem::path& folder);

  // One thread.
  void Color(const ColorPicture& picture);
  void Depth(const WatchedDepth& picture);

  // Writes what waits.
  RecordingStatus Finish();

 private:
  explicit PictureDump(const std::filesystem::path& folder);
  TakeRecorder recorder_;
};

}  // namespace mixstage
