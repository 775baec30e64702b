// SPDX-License-Identifier: Apache-2.0
//
// Pictures of 200 kB over a network that loses datagrams: how many come whole, beside one LCM message for
// each picture on the same network; what parity costs; how long a repair takes.
//   bench_transport [PICTURES]
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include "proto/base/clock.h"
#include "proto/link/message_bytes.h"
#include "proto/link/reassembler.h"
#include "tests/support/lossy_channel.h"

namespace mixstage {
namespace {

using Slice = mixstage_lcm::frame_slice_t;

constexpr std::size_t kPictureBytes = 200'000;
constexpr int kBurstSlices = 32;  // as the publisher sends: so many, then a pause of a millisecond

double Median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

EncodedFrame RandomPicture() {
  EncodedFrame frame;
  frame.epoch = 1;
  frame.width = 1024;
  frame.height = 768;
  frame.bytes.resize(kPictureBytes);
  std::mt19937_64 random(7);
  for (auto& b : frame.bytes) b = static_cast<std::uint8_t>(random());
  return frame;
}

// LCM 1.3.1 cuts a message into datagrams of up to 65,499 bytes, IP these into 1,480: all must come.
int PacketsOfOneMessage() {
  int packets = 0;
  for (std::size_t left = kPictureBytes; left > 0;) {
    const std::size_t datagram = std::min<std::size_t>(left, 65'499);
    packets += static_cast<int>((datagram + 8 + 1479) / 1480);
    left -= datagram;
  }
  return packets;
}

void WholePictures(const char* name, LossyChannelConfig network, double parity, int pictures) {
  EncodedFrame frame = RandomPicture();
  Reassembler reassembler;
  std::int64_t now_us = 0, start_us = 0, whole = 0, cut_us = 0, receive_us = 0, datagrams = 0;
  std::vector<double> delay_ms;
  std::vector<LossyChannel::Bytes> arrived;
  LossyChannel channel(network, [&](const LossyChannel::Bytes& bytes) { arrived.push_back(bytes); });
  using Timed = std::vector<std::pair<std::int64_t, LossyChannel::Bytes>>;
  auto receive = [&](const Timed& timed) {
    const std::int64_t receive_start_us = ThreadCpuMicros();
    for (const auto& [at_us, bytes] : timed) {
      now_us = at_us;
      Slice slice{};
      if (!DecodeMessage(bytes, slice)) continue;
      reassembler.Add(slice, now_us);
      while (auto picture = reassembler.Next(now_us)) {
        ++whole;
        delay_ms.push_back(static_cast<double>(now_us - picture->t_us) * 1e-3);
        if (picture->bytes != frame.bytes) std::printf("CORRUPT picture %ld\n", picture->sequence);
      }
    }
    receive_us += ThreadCpuMicros() - receive_start_us;
  };
  std::vector<Slice> slices;
  for (std::int64_t n = 0; n < pictures; ++n) {
    start_us = n * 33'333;
    frame.sequence = n;
    frame.t_us = start_us;
    slices.clear();
    const std::int64_t cut_start_us = ThreadCpuMicros();
    CutIntoSlices(
        frame, [&](const Slice& s) { slices.push_back(s); }, parity);
    cut_us += ThreadCpuMicros() - cut_start_us;
    datagrams = static_cast<std::int64_t>(slices.size());
    Timed timed;
    for (std::size_t i = 0; i < slices.size(); ++i) {
      const MessageBytes bytes(slices[i]);
      arrived.clear();
      channel.Send({bytes.data(), bytes.size()});
      for (auto& a : arrived)
        timed.emplace_back(start_us + 1000 * static_cast<std::int64_t>(i / kBurstSlices), std::move(a));
    }
    receive(timed);
  }
  arrived.clear();
  channel.Flush();
  Timed rest;
  for (auto& a : arrived) rest.emplace_back(now_us, std::move(a));
  receive(rest);
  // The same network, each picture one LCM message; a damaged packet is one that UDP's checksum refuses.
  std::int64_t messages = 0, arrived_packets = 0;
  const int packets = PacketsOfOneMessage();
  network.drop += network.truncate + network.flip;
  network.truncate = network.flip = network.duplicate = 0;
  network.reorder = 0;
  LossyChannel plain(network, [&](const LossyChannel::Bytes&) { ++arrived_packets; });
  for (int n = 0; n < pictures; ++n) {
    arrived_packets = 0;
    for (int i = 0; i < packets; ++i) plain.Send({});
    messages += arrived_packets == packets;
  }
  const double lost =
      static_cast<double>(plain.counters().dropped) / static_cast<double>(plain.counters().in);
  const double overhead =
      static_cast<double>(datagrams) * static_cast<double>(Slice{}.getEncodedSize()) / kPictureBytes - 1;
  std::sort(delay_ms.begin(), delay_ms.end());
  std::printf(
      "%-28s lost %.2f %%  parity %4.1f %%  whole %8.4f %%  one message: whole %5.1f %% (1-(1-p)^%d: %5.1f "
      "%% lost)  "
      "bytes +%.1f %%  cut %.0f us, receive %.0f us CPU  delay median %.1f ms, p99.9 %.1f ms\n",
      name, 100 * lost, 100 * parity, 100.0 * static_cast<double>(whole) / pictures,
      100.0 * static_cast<double>(messages) / pictures, packets, 100 * (1 - std::pow(1 - lost, packets)),
      100 * overhead, static_cast<double>(cut_us) / pictures, static_cast<double>(receive_us) / pictures,
      delay_ms[delay_ms.size() / 2], delay_ms[delay_ms.size() * 999 / 1000]);
}

void ParitySpeed(int k, int m) {
  std::vector<std::vector<std::uint8_t>> bytes(static_cast<std::size_t>(k + m),
                                               std::vector<std::uint8_t>(kSlicePayloadBytes, 3));
  std::vector<std::uint8_t*> data, parity;
  for (std::size_t i = 0; i < bytes.size(); ++i)
    (i < static_cast<std::size_t>(k) ? data : parity).push_back(bytes[i].data());
  const std::vector<const std::uint8_t*> data_const(data.begin(), data.end()),
      parity_const(parity.begin(), parity.end());
  ParityCoder coder;
  std::vector<double> encode_us;
  for (int round = 0; round < 21; ++round) {
    const std::int64_t start_us = ThreadCpuMicros();
    for (int i = 0; i < 20; ++i) coder.Encode(data_const, parity, kSlicePayloadBytes);
    encode_us.push_back(static_cast<double>(ThreadCpuMicros() - start_us) / 20);
  }
  const double us = Median(encode_us);
  std::printf("parity %d + %d: encode %.0f us, %.1f GB/s; repair", k, m, us,
              k * kSlicePayloadBytes / us * 1e-3);
  for (const int erasures : {1, 5, 15}) {
    if (erasures > m) continue;
    std::vector<bool> have_data(static_cast<std::size_t>(k), true);
    const std::vector<bool> have_parity(static_cast<std::size_t>(m), true);
    for (int e = 0; e < erasures; ++e) have_data[static_cast<std::size_t>(e * k / erasures)] = false;
    std::vector<double> repair_us;
    for (int round = 0; round < 21; ++round) {
      const std::int64_t start_us = ThreadCpuMicros();
      for (int i = 0; i < 20; ++i)
        coder.Repair(data, have_data, parity_const, have_parity, kSlicePayloadBytes, i);
      repair_us.push_back(static_cast<double>(ThreadCpuMicros() - start_us) / 20);
    }
    std::printf("  %d: %.0f us", erasures, Median(repair_us));
  }
  std::printf("\n");
}

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  using namespace mixstage;
  const int pictures = argc > 1 ? std::atoi(argv[1]) : 5000;
  if (pictures < 1) return 2;
  WholePictures("no loss", {}, 0.05, pictures);
  WholePictures("1 % loss", {.drop = 0.01}, 0.05, pictures);
  WholePictures("1 % loss", {.drop = 0.01}, 0, pictures);
  WholePictures("5 % loss", {.drop = 0.05}, 0.14, pictures);
  WholePictures("1 % in bursts of 3", {.burst_enter = 0.01 / 3, .burst_leave = 1.0 / 3}, 0.05, pictures);
  WholePictures("1 % in bursts of 3", {.burst_enter = 0.01 / 3, .burst_leave = 1.0 / 3}, 0.14, pictures);
  WholePictures("1 % loss, disorder 64", {.drop = 0.01, .reorder = 64}, 0.05, pictures);
  WholePictures("1 % loss, all doubled", {.drop = 0.01, .duplicate = 1}, 0.05, pictures);
  WholePictures("1 % damaged", {.truncate = 0.005, .flip = 0.005}, 0.05, pictures);
  ParitySpeed(150, 15);
  ParitySpeed(157, 8);
  return 0;
}
