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

std::vector<Slice> Slices(const EncodedFrame& frame, double parity = 0) {
  std::vector<Slice> slices;
  CutIntoSlices(
      frame, [&](const Slice& s) { slices.push_back(s); }, parity);
  return slices;
}

void Sign(Slice& s) { s.slice_crc32c = static_cast<std::int32_t>(SliceCrc32c(s)); }

// A reassembler with what it delivered; each slice comes 100 us after the one before.
struct Receiver {
  void Add(const Slice& s) {
    now_us += 100;
    reassembler.Add(s, now_us);
    Take();
  }
  void Add(const std::vector<Slice>& slices) {
    for (const Slice& s : slices) Add(s);
  }
  void Wait() {  // nothing comes for a while
    now_us += 300'000;
    Take();
  }
  void Take() {
    while (auto frame = reassembler.Next(now_us)) delivered.push_back(std::move(*frame));
  }
  std::vector<std::int64_t> Sequences() const {
    std::vector<std::int64_t> sequences;
    for (const EncodedFrame& f : delivered) sequences.push_back(f.sequence);
    return sequences;
  }
  const Reassembler::Counters& counters() const { return reassembler.counters(); }

  std::int64_t now_us = 1'000'000;
  Reassembler reassembler;
  std::vector<EncodedFrame> delivered;
};

std::vector<std::int64_t> UpTo(std::int64_t count) {
  std::vector<std::int64_t> numbers;
  for (std::int64_t n = 0; n < count; ++n) numbers.push_back(n);
  return numbers;
}

TEST(Reassembler, AnyOrderGivesTheSameBytesOnce) {
  const EncodedFrame sent = Picture(0);
  std::vector<Slice> slices = Slices(sent, 0.3);
  ASSERT_EQ(slices.size(), 6u);
  std::mt19937 random(1);
  for (int round = 0; round < 20; ++round) {
    std::shuffle(slices.begin(), slices.end(), random);
    Receiver receiver;
    receiver.Add(slices);
    ASSERT_EQ(receiver.delivered.size(), 1u);
    EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
    EXPECT_EQ(receiver.delivered[0].t_us, sent.t_us);
  }
}

TEST(Reassembler, DuplicatesAreNoOps) {
  Receiver receiver;
  for (std::int64_t n = 0; n < 10; ++n) {
    for (const Slice& s : Slices(Picture(n), 0.05)) receiver.Add({s, s});
  }
  EXPECT_EQ(receiver.Sequences(), UpTo(10));
  EXPECT_EQ(receiver.counters().duplicate_slice, 50);
  EXPECT_EQ(receiver.counters().spare_slice, 10);
  EXPECT_EQ(receiver.counters().late_slice, 0);
}

// Pictures smaller than the disorder are the hard case: several are overtaken whole.
TEST(Reassembler, DisorderOf64DatagramsAndDoublingChangeNothing) {
  for (const std::size_t bytes : {std::size_t{900}, std::size_t{5000}, std::size_t{200'000}}) {
    constexpr std::int64_t kPictures = 60;
    std::vector<Slice> slices;
    for (std::int64_t n = 0; n < kPictures; ++n) {
      for (const Slice& s : Slices(Picture(n, bytes), 0.05)) slices.insert(slices.end(), 2, s);
    }
    std::mt19937 random(5);
    std::vector<std::pair<std::size_t, std::size_t>> order;
    for (std::size_t i = 0; i < slices.size(); ++i) order.emplace_back(i + random() % 65, i);
    std::sort(order.begin(), order.end());
    Receiver receiver;
    for (const auto& [place, i] : order) receiver.Add(slices[i]);
    receiver.Wait();
    EXPECT_EQ(receiver.Sequences(), UpTo(kPictures)) << bytes;
    EXPECT_EQ(receiver.counters().incomplete + receiver.counters().late_slice, 0) << bytes;
  }
}

TEST(Reassembler, ParityRestoresAsManySlicesAsItHas) {
  const EncodedFrame sent = Picture(0, 200'000);
  auto slices = Slices(sent, 0.05);
  ASSERT_EQ(slices.size(), 157u + 8u);
  std::mt19937 random(2);
  for (const std::size_t lost : {1u, 8u, 9u}) {
    Receiver receiver;
    std::shuffle(slices.begin(), slices.end(), random);
    receiver.Add({slices.begin() + static_cast<std::ptrdiff_t>(lost), slices.end()});
    ASSERT_EQ(receiver.delivered.size(), lost <= 8 ? 1u : 0u) << lost;
    if (lost > 8) continue;
    EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
    EXPECT_EQ(receiver.counters().repaired, 1);
  }
}

TEST(Reassembler, ABurstIsSpreadOverTheGroupsOfALargePicture) {
  const EncodedFrame sent = Picture(0, 1'000'000);  // 782 data slices: four groups
  auto slices = Slices(sent, 0.05);
  ASSERT_EQ(slices.size(), 782u + 40u);
  slices.erase(slices.begin() + 301, slices.begin() + 341);
  Receiver receiver;
  receiver.Add(slices);
  ASSERT_EQ(receiver.delivered.size(), 1u);
  EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
}

TEST(Reassembler, AMissingSliceLosesOnlyItsPicture) {
  Receiver receiver;
  for (std::int64_t n = 0; n < 10; ++n) {
    for (const Slice& s : Slices(Picture(n))) {
      if (n != 4 || s.slice != 2) receiver.Add(s);
    }
  }
  receiver.Wait();
  EXPECT_EQ(receiver.Sequences(), (std::vector<std::int64_t>{0, 1, 2, 3, 5, 6, 7, 8, 9}));
  EXPECT_EQ(receiver.counters().incomplete, 1);
}

TEST(Reassembler, ALostPictureOfTheUsualSizeDelaysNobody) {
  Receiver receiver;
  receiver.Add(Slices(Picture(0, 200'000)));
  auto lost = Slices(Picture(1, 200'000));
  lost.pop_back();
  receiver.Add(lost);
  receiver.Add(Slices(Picture(2, 200'000)));
  EXPECT_EQ(receiver.Sequences(), (std::vector<std::int64_t>{0, 2}));  // without waiting
}

TEST(Reassembler, DamagedSlicesAreLostSlices) {
  const EncodedFrame sent = Picture(0, 20'000);
  auto slices = Slices(sent, 0.2);
  slices[1].payload[100] = static_cast<std::uint8_t>(slices[1].payload[100] ^ 1);
  slices[2].t_us ^= 1;
  slices[3].sequence ^= std::int64_t{1} << 40;
  Receiver receiver;
  receiver.Add(slices);
  ASSERT_EQ(receiver.delivered.size(), 1u);
  EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
  EXPECT_EQ(receiver.counters().bad_slice, 3);
}

TEST(Reassembler, ForgedDataIsNeverDeliveredAndParityOverrulesIt) {
  const EncodedFrame sent = Picture(0, 20'000);
  const auto slices = Slices(sent, 0.2);
  Slice forged = slices[5];
  forged.payload[7] = static_cast<std::uint8_t>(forged.payload[7] ^ 1);
  Sign(forged);
  Receiver unprotected;
  auto without = Slices(sent);
  without[5] = without[5];
  without[5].payload[7] = forged.payload[7];
  Sign(without[5]);
  unprotected.Add(without);
  EXPECT_TRUE(unprotected.delivered.empty());
  EXPECT_EQ(unprotected.counters().crc, 1);
  // Before, beside and after the true slice.
  for (const std::size_t before : {std::size_t{0}, std::size_t{5}, std::size_t{10}}) {
    auto with = slices;
    with.insert(with.begin() + static_cast<std::ptrdiff_t>(before), forged);
    Receiver receiver;
    receiver.Add(with);
    ASSERT_EQ(receiver.delivered.size(), 1u) << before;
    EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
  }
}

TEST(Reassembler, ForgedParityDoesNotStopTheTruth) {
  const EncodedFrame sent = Picture(0, 20'000);
  const auto slices = Slices(sent, 0.2);  // 16 + 4
  Slice forged = slices[16];
  forged.payload[7] = static_cast<std::uint8_t>(forged.payload[7] ^ 1);
  Sign(forged);
  {
    Receiver receiver;  // all data comes, late
    receiver.Add(forged);
    receiver.Add({slices.begin() + 1, slices.begin() + 16});
    EXPECT_TRUE(receiver.delivered.empty());
    receiver.Add(slices[0]);
    ASSERT_EQ(receiver.delivered.size(), 1u);
    EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
  }
  {
    Receiver receiver;  // data is lost, another parity slice comes
    receiver.Add(forged);
    receiver.Add({slices.begin() + 1, slices.begin() + 16});
    receiver.Add(slices[17]);
    ASSERT_EQ(receiver.delivered.size(), 1u);
    EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
  }
}

TEST(Reassembler, ASliceThatLiesAboutItsPictureSpoilsNothing) {
  const EncodedFrame sent = Picture(0);
  for (const bool first : {true, false}) {
    auto slices = Slices(sent);
    Slice liar = slices[1];
    liar.frame_bytes -= 1;
    Sign(liar);
    slices.insert(first ? slices.begin() : slices.begin() + 2, liar);
    Receiver receiver;
    receiver.Add(slices);
    ASSERT_EQ(receiver.delivered.size(), 1u);
    EXPECT_EQ(receiver.delivered[0].bytes, sent.bytes);
    EXPECT_EQ(receiver.counters().bad_slice, 1);
  }
}

TEST(Reassembler, NumbersThatAreLiesDoNotStopTheStream) {
  Receiver receiver;
  std::mt19937 random(6);
  for (std::int64_t n = 0; n < 400; ++n) {
    auto slices = Slices(Picture(n));
    Slice liar = slices[random() % slices.size()];
    liar.sequence += static_cast<std::int64_t>(random()) << 10;
    Sign(liar);
    receiver.Add(liar);
    receiver.Add(slices);
  }
  EXPECT_EQ(receiver.Sequences(), UpTo(400));
  // A whole forged picture stops it for a second, not for ever.
  receiver.Add(Slices(Picture(1'000'000'000)));
  receiver.Wait();
  EXPECT_EQ(receiver.delivered.back().sequence, 1'000'000'000);
  for (std::int64_t n = 400; n < 420; ++n) {
    receiver.Add(Slices(Picture(n)));
    receiver.now_us += 100'000;
  }
  receiver.Wait();
  EXPECT_EQ(receiver.delivered.back().sequence, 419);
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
  refused([](Slice& s) { s.parity_slices = 5; }, "parity_slices");
  refused([](Slice& s) { s.width = 0; }, "width");
  refused([](Slice& s) { s.stream = 9; }, "stream");
  refused([](Slice& s) { s.encoding = 2; }, "encoding");
  refused([](Slice& s) { s.t_us ^= 1; }, "slice_crc32c");
  refused([](Slice& s) { s.payload[1279] ^= 1; }, "slice_crc32c");
}

TEST(Reassembler, AFloodOfSourcesAndHugePicturesStaysBounded) {
  Reassembler reassembler;
  std::mt19937_64 random(3);
  Slice s = Slices(Picture(1, 2000))[0];
  s.frame_bytes = kMaxFrameBytes;
  s.slice_bytes = kSlicePayloadBytes;
  s.data_slices = (kMaxFrameBytes + kSlicePayloadBytes - 1) / kSlicePayloadBytes;
  s.parity_slices = s.data_slices;
  for (int i = 0; i < 3000; ++i) {
    s.epoch = static_cast<std::int64_t>(random() % 50) + 1;
    s.sequence = static_cast<std::int64_t>(random() % 1000);
    s.stream = static_cast<std::int8_t>(random() % 4 + 1);
    s.encoding = s.stream == 1 || s.stream == 4 ? 1 : 2;
    Sign(s);
    reassembler.Add(s, i);
    EXPECT_FALSE(reassembler.Next(i));
    EXPECT_LE(reassembler.open_bytes(), Reassembler::kMaxOpenBytes);
  }
  EXPECT_GT(reassembler.counters().no_room, 0);
  EXPECT_GT(reassembler.counters().quota, 0);
  // A real source is heard once the flood has been silent for a while.
  for (const Slice& real : Slices(Picture(0))) reassembler.Add(real, 60'000'000);
  EXPECT_TRUE(reassembler.Next(60'000'000));
}

TEST(Reassembler, AFloodingSourceDoesNotPushOutAnother) {
  Receiver receiver;
  std::mt19937_64 random(4);
  Slice flood = Slices(Picture(1, 2000))[0];
  flood.epoch = 666;
  flood.frame_bytes = kMaxFrameBytes;
  flood.data_slices = (kMaxFrameBytes + kSlicePayloadBytes - 1) / kSlicePayloadBytes;
  for (std::int64_t n = 0; n < 60; ++n) {
    for (const Slice& s : Slices(Picture(n, 100'000), 0.05)) {
      receiver.Add(s);
      for (int i = 0; i < 20; ++i) {  // 200,000 slices a second
        flood.sequence = static_cast<std::int64_t>(random() % 100'000);
        Sign(flood);
        receiver.reassembler.Add(flood, receiver.now_us);
      }
    }
  }
  EXPECT_EQ(receiver.Sequences(), UpTo(60));
  EXPECT_GT(receiver.counters().quota, 0);
  EXPECT_EQ(receiver.counters().no_room, 0);
}

TEST(Reassembler, ANewEpochStartsItsSequenceAfresh) {
  Receiver receiver;
  receiver.Add(Slices(Picture(1000)));
  EncodedFrame restarted = Picture(0);
  restarted.epoch = 43;
  receiver.Add(Slices(restarted));
  receiver.Wait();
  EXPECT_EQ(receiver.Sequences(), (std::vector<std::int64_t>{0, 1000}));  // 0 is first: 1000 waited for 999
}

TEST(Reassembler, TheShareOfLostSlicesIsTold) {
  Receiver receiver;
  for (std::int64_t n = 0; n < 100; ++n) {
    for (const Slice& s : Slices(Picture(n, 24'000), 0.05)) {  // 19 + 1
      if (n % 2 == 0 && s.slice == 4) continue;
      receiver.Add({s, s});
    }
  }
  receiver.Wait();
  receiver.Wait();
  const auto stats = receiver.reassembler.Stats(42, receiver.now_us);
  EXPECT_NEAR(stats.slice_loss, 0.025, 1e-3);
  EXPECT_EQ(stats.repaired, 50);
  EXPECT_EQ(receiver.reassembler.Stats(42, receiver.now_us + 20'000'000).slice_loss, 0);
}

}  // namespace
}  // namespace mixstage
