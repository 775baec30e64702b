// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"

namespace mixstage {

struct SyntheticTakeConfig {
  double begin_s = 0, end_s = 12;  // of the synthetic loop
  int clean_plate_frames = 10;     // 0 = no clean plate
  std::optional<Rig> rig;          // that sees the set; none = the demonstration's
};

// Writes a capture folder of the synthetic set (rgb, depth, amplitude, rig.json, clean_plate) and, beside it
// in truth/: matte/STEM.png (8 bit), depth/STEM.png (16 bit, mm), groundtruth.txt. For tests and
// demonstrations of `process`; the server never sees the truth.
Status WriteSyntheticTake(const std::filesystem::path& folder, const SyntheticTakeConfig& config);

}  // namespace mixstage
