// SPDX-License-Identifier: Apache-2.0
#include "proto/link/scan_progress.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

namespace mixstage {
namespace {

ScanProgress HalfWay() {
  using enum SweepCell;
  return {.state = ScanState::kSweep,
          .positions = 6,
          .recorded = 2,
          .left_out = 1,
          .map = {.columns = 3,
                  .rows = 2,
                  .pan_deg = {30, -30},
                  .tilt_deg = {10, -10},
                  .cells = {kRecorded, kLeftOut, kRecorded, kToCome, kToCome, kHead}},
          .notes = "pan 0.0 tilt 10.0: too few depth frames came\n"};
}

TEST(ScanProgress, ComesBack) {
  ScanProgress said = HalfWay();
  for (const ScanState state :
       {ScanState::kSweep, ScanState::kCompute, ScanState::kDone, ScanState::kFailed}) {
    said.state = state;
    said.text = "Schritt für Schritt";
    said.coverage = 0.5;
    said.triangles = 140'000;
    const auto heard = ReadScanProgress(ToMessage(said));
    ASSERT_TRUE(heard) << heard.error().message;
    EXPECT_EQ(heard->state, said.state);
    EXPECT_EQ(heard->positions, said.positions);
    EXPECT_EQ(heard->recorded, said.recorded);
    EXPECT_EQ(heard->left_out, said.left_out);
    EXPECT_EQ(heard->map.columns, said.map.columns);
    EXPECT_EQ(heard->map.rows, said.map.rows);
    EXPECT_EQ(heard->map.pan_deg, said.map.pan_deg);
    EXPECT_EQ(heard->map.tilt_deg, said.map.tilt_deg);
    EXPECT_EQ(heard->map.cells, said.map.cells);
    EXPECT_EQ(heard->coverage, said.coverage);
    EXPECT_EQ(heard->triangles, said.triangles);
    EXPECT_EQ(heard->text, said.text);
    EXPECT_EQ(heard->notes, said.notes);
  }
}

TEST(ScanProgress, LongTextsEndWithAWholeCharacterAndNotesWithAWholeLine) {
  ScanProgress said = HalfWay();
  said.text = "x";
  for (int i = 0; i < 200; ++i) said.text += "ü";
  for (int i = 0; i < 40; ++i) said.notes += "pan 0.0 tilt 10.0: no colour picture came\n";
  const auto heard = ReadScanProgress(ToMessage(said));
  ASSERT_TRUE(heard);
  EXPECT_EQ(heard->text, said.text.substr(0, 159));
  EXPECT_LE(heard->notes.size(), 448u);
  EXPECT_GT(heard->notes.size(), 380u);
  EXPECT_TRUE(heard->notes.ends_with("came"));
  said.notes = std::string(1000, 'n');  // one line that does not fit
  EXPECT_EQ(ReadScanProgress(ToMessage(said))->notes, said.notes.substr(0, 448));
}

TEST(ScanProgress, EveryFieldOutOfItsRangeIsNamed) {
  using Message = mixstage_lcm::scan_progress_t;
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const std::pair<const char*, std::function<void(Message&)>> wrong[] = {
      {"epoch", [](Message& m) { m.epoch = 0; }},
      {"sequence", [](Message& m) { m.sequence = -1; }},
      {"sequence", [](Message& m) { m.sequence = std::numeric_limits<std::int64_t>::max(); }},
      {"state", [](Message& m) { m.state = 0; }},
      {"state", [](Message& m) { m.state = 5; }},
      {"positions", [](Message& m) { m.positions = 0; }},
      {"positions", [](Message& m) { m.positions = kMaxSweepPositions + 1; }},
      {"recorded", [](Message& m) { m.recorded = 7; }},
      {"recorded", [](Message& m) { m.recorded = -1; }},
      {"left_out", [](Message& m) { m.left_out = 7; }},
      {"left_out", [](Message& m) { m.left_out = -1; }},
      {"columns, rows", [](Message& m) { m.columns = 0; }},
      {"columns, rows", [](Message& m) { m.columns = m.rows = -2; }},
      {"columns, rows", [](Message& m) { m.columns = m.rows = 32767; }},
      {"pan_deg", [](Message& m) { m.pan_deg[1] = kNan; }},
      {"tilt_deg", [](Message& m) { m.tilt_deg[0] = std::numeric_limits<float>::infinity(); }},
      {"cells", [](Message& m) { m.cells[511] = 4; }},
      {"coverage", [](Message& m) { m.coverage = kNan; }},
      {"coverage", [](Message& m) { m.coverage = 1.01f; }},
      {"triangles", [](Message& m) { m.triangles = -1; }},
  };
  for (const auto& [field, change] : wrong) {
    Message message = ToMessage(HalfWay());
    change(message);
    const auto heard = ReadScanProgress(message);
    ASSERT_FALSE(heard) << field;
    EXPECT_EQ(heard.error().code, ErrorCode::kBadInput);
    EXPECT_NE(heard.error().message.find(field), std::string::npos) << heard.error().message;
  }
}

TEST(ScanProgress, TextsThatFillTheirFieldsAndControlCharactersAreRead) {
  mixstage_lcm::scan_progress_t message = ToMessage(HalfWay());
  std::fill(std::begin(message.text), std::end(message.text), std::uint8_t{'t'});
  std::fill(std::begin(message.notes), std::end(message.notes), std::uint8_t{0x1B});
  const auto heard = ReadScanProgress(message);
  ASSERT_TRUE(heard);
  EXPECT_EQ(heard->text, std::string(160, 't'));
  EXPECT_EQ(heard->notes, std::string(448, ' '));
}

}  // namespace
}  // namespace mixstage
