// SPDX-License-Identifier: Apache-2.0
#include "proto/link/reassembler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace mixstage {
namespace {

using Slice = mixstage_lcm::frame_slice_t;

EncodedFrame Picture(std::int64_t sequence, std::size_t bytes = 5000) {
  EncodedFrame frame;
  frame.epoch = 42;
  frame.t_us = 1000 * sequence;
  frame.sequence = sequence;
  frame.width = 64;
  frame.height = 48;
  std::mt19937 random(static_cast<unsigned>(sequence));
  frame.bytes.resize(bytes);
  for (auto& b : frame.bytes) b = static_cast<std::uint8_t>(random());
  return frame;
}

std::vector<Slice> Slices(const EncodedFrame& frame) {
  std::vector<Slice> slices;
  CutIntoSlices(frame, [&](const Slice& s) { slices.push_back(s); });
  return slices;
}

TEST(Reassembler, AnyOrderGivesTheSameBytesOnce) {
  const EncodedFrame sent = Picture(7);
  std::vector<Slice> slices = Slices(sent);
  ASSERT_EQ(slices.size(), 4u);
  std::mt19937 random(1);
  for (int round = 0; round < 20; ++round) {
    std::shuffle(slices.begin(), slices.end(), random);
    Reassembler reassembler;
    int delivered = 0;
    for (const Slice& s : slices) {
      if (auto frame = reassembler.Add(s, 0)) {
        ++delivered;
        EXPECT_EQ(frame->bytes, sent.bytes);
        EXPECT_EQ(frame->t_us, sent.t_us);
      }
    }
    EXPECT_EQ(delivered, 1);
  }
}

TEST(Reassembler, DuplicatesAreNoOps) {
  Reassembler reassembler;
  int delivered = 0;
  for (std::int64_t n = 0; n < 10; ++n) {
    for (const Slice& s : Slices(Picture(n))) {
      delivered += reassembler.Add(s, 0).has_value();
      delivered += reassembler.Add(s, 0).has_value();
    }
  }
  EXPECT_EQ(delivered, 10);
  EXPECT_EQ(reassembler.counters().duplicate_slice + reassembler.counters().late_slice, 40);
}

TEST(Reassembler, AMissingSliceLosesOnlyItsPicture) {
  Reassembler reassembler;
  int delivered = 0;
  for (std::int64_t n = 0; n < 10; ++n) {
    for (const Slice& s : Slices(Picture(n))) {
      if (n == 4 && s.slice == 2) continue;
      delivered += reassembler.Add(s, 0).has_value();
    }
  }
  EXPECT_EQ(delivered, 9);
  EXPECT_EQ(reassembler.counters().incomplete, 1);
}

TEST(Reassembler, DamagedBytesAreNeverDelivered) {
  Reassembler reassembler;
  auto slices = Slices(Picture(1));
  slices[1].payload[100] = static_cast<std::uint8_t>(slices[1].payload[100] ^ 1);
  for (const Slice& s : slices) EXPECT_FALSE(reassembler.Add(s, 0));
  EXPECT_EQ(reassembler.counters().crc, 1);
}

TEST(Reassembler, ASliceThatContradictsItsPictureIsRefused) {
  Reassembler reassembler;
  auto slices = Slices(Picture(1));
  EXPECT_FALSE(reassembler.Add(slices[0], 0));
  Slice liar = slices[1];
  liar.frame_bytes -= 1;
  EXPECT_FALSE(reassembler.Add(liar, 0));
  EXPECT_EQ(reassembler.counters().bad_slice, 1);
}

TEST(Reassembler, FieldsOutOfRangeAreRefusedByName) {
  const Slice good = Slices(Picture(1))[0];
  EXPECT_TRUE(ValidateSlice(good));
  auto refused = [&](auto change, const char* field) {
    Slice s = good;
    change(s);
    const Status status = ValidateSlice(s);
    EXPECT_FALSE(status) << field;
    if (!status) {
      EXPECT_NE(status.error().message.find(field), std::string::npos);
    }
  };
  refused([](Slice& s) { s.epoch = 0; }, "epoch");
  refused([](Slice& s) { s.frame_bytes = 0; }, "frame_bytes");
  refused([](Slice& s) { s.frame_bytes = 1 << 30; }, "frame_bytes");
  refused([](Slice& s) { s.slice = s.data_slices; }, "slice");
  refused([](Slice& s) { s.slice = -1; }, "slice");
  refused([](Slice& s) { s.slice_bytes = 0; }, "slice_bytes");
  refused([](Slice& s) { s.slice_bytes = 1281; }, "slice_bytes");
  refused([](Slice& s) { s.data_slices = 5; }, "data_slices");
  refused([](Slice& s) { s.width = 0; }, "width");
  refused([](Slice& s) { s.stream = 9; }, "stream");
  refused([](Slice& s) { s.encoding = 2; }, "encoding");
}

TEST(Reassembler, AFloodOfSourcesAndHugePicturesStaysBounded) {
  Reassembler reassembler;
  std::mt19937_64 random(3);
  Slice s = Slices(Picture(1, 2000))[0];
  s.frame_bytes = kMaxFrameBytes;
  s.slice_bytes = kSlicePayloadBytes;
  s.data_slices = (kMaxFrameBytes + kSlicePayloadBytes - 1) / kSlicePayloadBytes;
  for (int i = 0; i < 3000; ++i) {
    s.epoch = static_cast<std::int64_t>(random() % 50) + 1;
    s.sequence = static_cast<std::int64_t>(random() % 1000);
    s.stream = static_cast<std::int8_t>(random() % 4 + 1);
    s.encoding = s.stream == 1 || s.stream == 4 ? 1 : 2;
    EXPECT_FALSE(reassembler.Add(s, i));
  }
  EXPECT_GT(reassembler.counters().no_room, 0);
  // A real source is still heard once the flood has been silent for a while.
  int delivered = 0;
  for (const Slice& real : Slices(Picture(3))) delivered += reassembler.Add(real, 60'000'000).has_value();
  EXPECT_EQ(delivered, 1);
}

TEST(Reassembler, ANewEpochStartsItsSequenceAfresh) {
  Reassembler reassembler;
  for (const Slice& s : Slices(Picture(1000))) reassembler.Add(s, 0);
  EncodedFrame restarted = Picture(0);
  restarted.epoch = 43;
  int delivered = 0;
  for (const Slice& s : Slices(restarted)) delivered += reassembler.Add(s, 1).has_value();
  EXPECT_EQ(delivered, 1);
}

}  // namespace
}  // namespace mixstage
