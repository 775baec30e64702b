// SPDX-License-Identifier: Apache-2.0
//
// Damaged pictures without end: cut, damaged on the wire or by a liar who signs what he sends, put together
// again. What comes out must be what went in, byte for byte, or nothing.
//   transport_stress [PICTURES] [SEED]      prints a JSON line; exit code 4 when a picture came out wrong
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <map>
#include <random>
#include <vector>

#include "proto/link/message_bytes.h"
#include "proto/link/reassembler.h"

namespace mixstage {
namespace {

using Slice = mixstage_lcm::frame_slice_t;
using Bytes = std::vector<std::uint8_t>;

class Stress {
 public:
  explicit Stress(std::uint64_t seed) : random_(seed), noise_(1 << 16) {
    for (auto& b : noise_) b = static_cast<std::uint8_t>(random_());
  }

  void OnePicture() {
    const EncodedFrame frame = NextPicture();
    std::vector<Slice> slices;
    CutIntoSlices(
        frame, [&](const Slice& s) { slices.push_back(s); }, 0.2 * static_cast<double>(Below(4)));
    std::vector<Bytes> datagrams;
    const std::size_t victim = Below(slices.size());
    for (std::size_t i = 0; i < slices.size(); ++i) {
      const bool hurt = i == victim || Below(8) == 0;
      if (!hurt) {
        Append(datagrams, slices[i]);
      } else if (slices[0].data_slices > 1 && i == victim && Below(2) == 0) {
        // A liar's slice beside or instead of the true one. He signs it: only the whole picture's CRC is
        // against him. (Who signs all that a picture needs is its sender.)
        Append(datagrams, Lie(slices[i]));
        if (Below(2) == 0) Append(datagrams, slices[i]);
      } else {
        Append(datagrams, slices[i]);
        Damage(datagrams.back());
      }
    }
    for (std::size_t swaps = Below(4); swaps > 0; --swaps)
      std::swap(datagrams[Below(datagrams.size())], datagrams[Below(datagrams.size())]);
    for (const Bytes& bytes : datagrams) Receive(bytes);
    now_us_ += 200;
    ++damaged_;
  }

  int Report() {
    now_us_ += 1'000'000;
    TakeAll();
    const auto& c = reassembler_.counters();
    std::printf(
        "{\"damaged\": %ld, \"delivered_whole\": %ld, \"delivered_corrupt\": %ld, \"repaired\": %ld, "
        "\"bad_slice\": %ld, \"undecodable\": %ld, \"incomplete\": %ld, \"crc\": %ld, \"most_open_bytes\": "
        "%zu}\n",
        damaged_, whole_, corrupt_, c.repaired, c.bad_slice, undecodable_, c.incomplete, c.crc,
        most_open_bytes_);
    return corrupt_ == 0 ? 0 : 4;
  }

 private:
  std::size_t Below(std::size_t count) { return random_() % count; }

  EncodedFrame NextPicture() {
    EncodedFrame frame;
    frame.epoch = 1 + static_cast<std::int64_t>(Below(3));
    frame.stream = static_cast<Stream>(1 + Below(4));
    const bool color = frame.stream == Stream::kColor || frame.stream == Stream::kFisheye;
    frame.encoding = color ? Encoding::kJpeg : Encoding::kDepth16;
    frame.sequence = next_sequence_[{frame.epoch, frame.stream}]++;
    frame.t_us = now_us_;
    frame.width = 1 + static_cast<int>(Below(1000));
    frame.height = 1 + static_cast<int>(Below(1000));
    const std::size_t size = 1 + Below(Below(4) == 0 ? 12'000 : 4'000);
    const std::size_t begin = Below(noise_.size() - size);
    frame.bytes.assign(noise_.begin() + static_cast<std::ptrdiff_t>(begin),
                       noise_.begin() + static_cast<std::ptrdiff_t>(begin + size));
    sent_.push_back(frame);
    if (sent_.size() > 2000) sent_.pop_front();
    return frame;
  }

  Slice Lie(Slice s) {
    switch (Below(9)) {
      case 0:
        Flip(s.payload[Below(static_cast<std::size_t>(s.slice_bytes))]);
        break;
      case 1:
        s.slice = static_cast<std::int16_t>(Below(20));
        break;
      case 2:
        s.sequence += static_cast<std::int64_t>(Below(1 << 20)) - 1000;
        break;
      case 3:
        s.t_us ^= static_cast<std::int64_t>(1 + Below(1 << 30));
        break;
      case 4:
        s.frame_bytes = static_cast<std::int32_t>(1 + Below(200'000));
        Recount(s);
        break;
      case 5:
        s.slice_bytes = static_cast<std::int16_t>(1 + Below(1280));
        Recount(s);
        break;
      case 6:
        s.parity_slices = static_cast<std::int16_t>(Below(static_cast<std::size_t>(s.data_slices) + 1));
        break;
      case 7:
        s.width = static_cast<std::int16_t>(1 + Below(8192));
        break;
      default:
        s.frame_crc32c = static_cast<std::int32_t>(random_());
        break;
    }
    s.slice_crc32c = static_cast<std::int32_t>(SliceCrc32c(s));
    return s;
  }
  static void Recount(Slice& s) {
    s.data_slices = static_cast<std::int16_t>((s.frame_bytes + s.slice_bytes - 1) / s.slice_bytes);
    s.parity_slices = std::min(s.parity_slices, s.data_slices);
  }

  void Damage(Bytes& bytes) {
    switch (Below(4)) {
      case 0:
        bytes.resize(Below(bytes.size()));
        break;
      case 1:  // in the fields
        for (std::size_t bits = 1 + Below(6); bits > 0; --bits) Flip(bytes[Below(58)]);
        break;
      case 2:
        for (std::size_t bits = 1 + Below(40); bits > 0; --bits) Flip(bytes[Below(bytes.size())]);
        break;
      default: {
        const std::size_t begin = Below(bytes.size()), end = begin + Below(bytes.size() - begin) + 1;
        const auto fill = static_cast<std::uint8_t>(random_());
        for (std::size_t i = begin; i < end; ++i)
          bytes[i] = Below(2) == 0 ? fill : static_cast<std::uint8_t>(random_());
        break;
      }
    }
  }
  void Flip(std::uint8_t& byte) { byte = static_cast<std::uint8_t>(byte ^ (1u << Below(8))); }

  static void Append(std::vector<Bytes>& datagrams, const Slice& slice) {
    const MessageBytes bytes(slice);
    datagrams.emplace_back(bytes.data(), bytes.data() + bytes.size());
  }

  void Receive(const Bytes& bytes) {
    Slice slice{};
    if (!DecodeMessage(bytes, slice)) {
      ++undecodable_;
      return;
    }
    reassembler_.Add(slice, now_us_);
    most_open_bytes_ = std::max(most_open_bytes_, reassembler_.open_bytes());
    TakeAll();
  }

  void TakeAll() {
    while (auto got = reassembler_.Next(now_us_)) {
      const auto same = std::find_if(sent_.rbegin(), sent_.rend(), [&](const EncodedFrame& s) {
        return s.epoch == got->epoch && s.stream == got->stream && s.sequence == got->sequence &&
               s.t_us == got->t_us && s.width == got->width && s.height == got->height &&
               s.encoding == got->encoding && s.bytes == got->bytes;
      });
      ++(same == sent_.rend() ? corrupt_ : whole_);
    }
  }

  std::mt19937_64 random_;
  Bytes noise_;
  std::map<std::pair<std::int64_t, Stream>, std::int64_t> next_sequence_;
  std::deque<EncodedFrame> sent_;
  Reassembler reassembler_;
  std::int64_t now_us_ = 1'000'000;
  std::int64_t damaged_ = 0, whole_ = 0, corrupt_ = 0, undecodable_ = 0;
  std::size_t most_open_bytes_ = 0;
};

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  const long pictures = argc > 1 ? std::atol(argv[1]) : 1'000'000;
  mixstage::Stress stress(argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1);
  for (long i = 0; i < pictures; ++i) stress.OnePicture();
  return stress.Report();
}
