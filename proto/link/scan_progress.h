// SPDX-License-Identifier: Apache-2.0
//
// How a live scan goes (SPEC.md 2.7), as the scan says it and as the server may believe it.
#pragma once

#include <array>
#include <cstdint>
#include <mixstage_lcm/scan_progress_t.hpp>
#include <string>
#include <vector>

#include "proto/base/result.h"

namespace mixstage {

enum class ScanState : std::int8_t { kSweep = 1, kCompute, kDone, kFailed };
enum class SweepCell : std::uint8_t { kToCome = 0, kRecorded, kLeftOut, kHead };

inline constexpr int kMaxSweepCells = 512;
inline constexpr int kMaxSweepPositions = 1'000'000;

// The positions of a sweep as the head sees them: row by row from the top, each from the left.
struct SweepMap {
  int columns = 0, rows = 0;          // 0 x 0: more cells than a message holds
  std::array<float, 2> pan_deg{};     // of the first column and the last
  std::array<float, 2> tilt_deg{};    // of the first row and the last
  std::vector<SweepCell> cells = {};  // columns x rows
};

struct ScanProgress {
  ScanState state = ScanState::kSweep;
  int positions = 1, recorded = 0, left_out = 0;
  SweepMap map = {};
  double coverage = 0;     // kDone: 0 .. 1
  int triangles = 0;       // kDone
  std::string text = {};   // kCompute: the step at work; kFailed: why
  std::string notes = {};  // lines: what was left out and why
};

// Texts that are too long are cut, notes after a whole line. Other fields beyond their limits are a caller's
// bug (checked). epoch and sequence are the sender's to fill in.
[[nodiscard]] mixstage_lcm::scan_progress_t ToMessage(const ScanProgress& progress);

// Checks every field; names the first that is out of its range. Bytes of the texts that are control
// characters become spaces.
Result<ScanProgress> ReadScanProgress(const mixstage_lcm::scan_progress_t& message);

}  // namespace mixstage
