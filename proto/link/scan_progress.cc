// SPDX-License-Identifier: Apache-2.0
#include "proto/link/scan_progress.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string_view>

#include "proto/base/check.h"
#include "proto/link/fixed_text.h"
#include "proto/link/frame_slice.h"

namespace mixstage {
namespace {

constexpr float kMaxAngle_deg = 1000;

bool IsMap(int columns, int rows) {
  return (columns == 0 && rows == 0) || (columns > 0 && rows > 0 && columns * rows <= kMaxSweepCells);
}

// The first field that is wrong; empty where all are right.
std::string WrongField(const mixstage_lcm::scan_progress_t& m) {
  const auto angle = [](float deg) { return std::abs(deg) <= kMaxAngle_deg; };  // false for NaN
  if (m.epoch == 0) return "epoch";
  if (m.sequence < 0 || !IsCountable(m.sequence)) return "sequence";
  if (m.state < 1 || m.state > 4) return "state";
  if (m.positions < 1 || m.positions > kMaxSweepPositions) return "positions";
  if (m.recorded < 0 || m.recorded > m.positions) return "recorded";
  if (m.left_out < 0 || m.left_out > m.positions) return "left_out";
  if (!IsMap(m.columns, m.rows)) return "columns, rows";
  if (!angle(m.pan_deg[0]) || !angle(m.pan_deg[1])) return "pan_deg";
  if (!angle(m.tilt_deg[0]) || !angle(m.tilt_deg[1])) return "tilt_deg";
  if (std::any_of(std::begin(m.cells), std::end(m.cells), [](std::uint8_t c) { return c > 3; }))
    return "cells";
  if (!(m.coverage >= 0 && m.coverage <= 1)) return "coverage";
  if (m.triangles < 0) return "triangles";
  return "";
}

}  // namespace

mixstage_lcm::scan_progress_t ToMessage(const ScanProgress& p) {
  mixstage_lcm::scan_progress_t m{};
  MIX_CHECK(static_cast<int>(p.map.cells.size()) == p.map.columns * p.map.rows);
  m.epoch = 1;
  m.state = static_cast<std::int8_t>(p.state);
  m.positions = p.positions;
  m.recorded = p.recorded;
  m.left_out = p.left_out;
  MIX_CHECK(IsMap(p.map.columns, p.map.rows));
  m.columns = static_cast<std::int16_t>(p.map.columns);
  m.rows = static_cast<std::int16_t>(p.map.rows);
  std::copy(p.map.pan_deg.begin(), p.map.pan_deg.end(), m.pan_deg);
  std::copy(p.map.tilt_deg.begin(), p.map.tilt_deg.end(), m.tilt_deg);
  std::transform(p.map.cells.begin(), p.map.cells.end(), m.cells,
                 [](SweepCell cell) { return static_cast<std::uint8_t>(cell); });
  m.coverage = static_cast<float>(p.coverage);
  m.triangles = p.triangles;
  WriteFixedText(p.text, m.text);
  std::string_view notes = p.notes;
  if (notes.size() > sizeof m.notes) {
    const std::size_t end = notes.rfind('\n', sizeof m.notes);
    notes = notes.substr(0, end);
  }
  WriteFixedText(notes, m.notes);
  MIX_CHECK(WrongField(m).empty());
  return m;
}

Result<ScanProgress> ReadScanProgress(const mixstage_lcm::scan_progress_t& m) {
  if (const std::string field = WrongField(m); !field.empty())
    return Fail(ErrorCode::kBadInput, "scan progress: " + field + " out of range");
  ScanProgress p;
  p.state = static_cast<ScanState>(m.state);
  p.positions = m.positions;
  p.recorded = m.recorded;
  p.left_out = m.left_out;
  p.map.columns = m.columns;
  p.map.rows = m.rows;
  std::copy(std::begin(m.pan_deg), std::end(m.pan_deg), p.map.pan_deg.begin());
  std::copy(std::begin(m.tilt_deg), std::end(m.tilt_deg), p.map.tilt_deg.begin());
  std::transform(m.cells, m.cells + m.columns * m.rows, std::back_inserter(p.map.cells),
                 [](std::uint8_t cell) { return static_cast<SweepCell>(cell); });
  p.coverage = m.coverage;
  p.triangles = m.triangles;
  p.text = ReadFixedText(m.text);
  p.notes = ReadFixedText(m.notes);
  return p;
}

}  // namespace mixstage
