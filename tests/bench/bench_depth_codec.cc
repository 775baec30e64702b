// SPDX-License-Identifier: Apache-2.0
//
// The depth codec beside its peers (RVL, PNG-16, plain zstd) on the 16-bit pictures of folders:
//   bench_depth_codec DIR [DIR ...]      each DIR holds 16-bit PNG files
#include <zstd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "proto/base/clock.h"
#include "proto/codec/depth_codec.h"

namespace {

using mixstage::ThreadCpuMicros;
using Bytes = std::vector<std::uint8_t>;

// RVL as its paper describes it (Wilson 2017): runs of zeros and of values, values as zigzag differences,
// both in nibbles with a continuation bit. Written here as the yardstick, encoder only.
class Rvl {
 public:
  void Encode(const cv::Mat1w& picture, Bytes& out) {
    out.clear();
    word_ = 0;
    nibbles_ = 0;
    const std::uint16_t* p = picture[0];
    const std::uint16_t* end = p + picture.total();
    int previous = 0;
    while (p != end) {
      std::uint32_t zeros = 0;
      for (; p != end && *p == 0; ++p) ++zeros;
      Put(zeros, out);
      std::uint32_t values = 0;
      for (const std::uint16_t* q = p; q != end && *q != 0; ++q) ++values;
      Put(values, out);
      for (std::uint32_t i = 0; i < values; ++i) {
        const int delta = *p++ - previous;
        Put((static_cast<std::uint32_t>(delta) << 1) ^ static_cast<std::uint32_t>(delta >> 31), out);
        previous = p[-1];
      }
    }
    while (nibbles_ != 0) Nibble(0, out);
  }

 private:
  void Put(std::uint32_t value, Bytes& out) {
    do {
      std::uint32_t nibble = value & 7u;
      if (value >>= 3) nibble |= 8u;
      Nibble(nibble, out);
    } while (value);
  }
  void Nibble(std::uint32_t nibble, Bytes& out) {
    word_ = (word_ << 4) | nibble;
    if (++nibbles_ == 8) {
      for (int i = 0; i < 4; ++i) out.push_back(static_cast<std::uint8_t>(word_ >> (8 * i)));
      nibbles_ = 0;
      word_ = 0;
    }
  }
  std::uint32_t word_ = 0;
  int nibbles_ = 0;
};

struct Sum {
  double encode_us = 0, decode_us = 0, packed_bytes = 0, raw_bytes = 0;
};

// Median of a few runs: other work shares the cores.
template <typename Work>
double MedianMicros(Work work) {
  std::vector<std::int64_t> runs;
  for (int i = 0; i < 5; ++i) {
    const std::int64_t start = ThreadCpuMicros();
    work();
    runs.push_back(ThreadCpuMicros() - start);
  }
  std::nth_element(runs.begin(), runs.begin() + 2, runs.end());
  return static_cast<double>(runs[2]);
}

void Print(const char* name, const Sum& s) {
  std::printf("  %-32s ratio %6.2f   encode %6.0f MB/s", name, s.raw_bytes / s.packed_bytes,
              s.raw_bytes / s.encode_us);
  if (s.decode_us > 0) std::printf("   decode %6.0f MB/s", s.raw_bytes / s.decode_us);
  std::printf("\n");
}

// Adds what one folder measured to `all` (ours only).
int Measure(const std::string& folder, Sum& all) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() == ".png") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  Sum ours, rvl, png, plain;
  mixstage::DepthEncoder encoder;
  mixstage::DepthDecoder decoder;
  Rvl rvl_encoder;
  Bytes bytes;
  int frames = 0;
  for (const auto& file : files) {
    const cv::Mat loaded = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
    if (loaded.type() != CV_16UC1) continue;
    const cv::Mat1w picture = loaded;
    ++frames;
    const double raw = 2.0 * static_cast<double>(picture.total());
    for (Sum* s : {&ours, &rvl, &png, &plain}) s->raw_bytes += raw;
    ours.encode_us += MedianMicros([&] { encoder.Encode(mixstage::View(picture), bytes); });
    ours.packed_bytes += static_cast<double>(bytes.size());
    cv::Mat1w back;
    ours.decode_us += MedianMicros([&] {
      if (!decoder.Decode(bytes, back)) std::abort();
    });
    if (cv::countNonZero(back != picture) != 0) {
      std::fprintf(stderr, "%s: not lossless\n", file.c_str());
      return 1;
    }
    rvl.encode_us += MedianMicros([&] { rvl_encoder.Encode(picture, bytes); });
    rvl.packed_bytes += static_cast<double>(bytes.size());
    png.encode_us += MedianMicros([&] {
      cv::imencode(".png", picture, bytes, {cv::IMWRITE_PNG_COMPRESSION, 1});
    });
    png.packed_bytes += static_cast<double>(bytes.size());
    bytes.resize(ZSTD_compressBound(picture.total() * 2));
    std::size_t size = 0;
    plain.encode_us += MedianMicros(
        [&] { size = ZSTD_compress(bytes.data(), bytes.size(), picture.data, picture.total() * 2, 1); });
    plain.packed_bytes += static_cast<double>(size);
  }
  if (frames == 0) {
    std::fprintf(stderr, "%s: no 16-bit PNG files\n", folder.c_str());
    return 3;
  }
  std::printf("%s: %d pictures\n", folder.c_str(), frames);
  Print("MixStage depth codec", ours);
  Print("RVL", rvl);
  Print("PNG-16 level 1", png);
  Print("zstd -1", plain);
  all.encode_us += ours.encode_us;
  all.decode_us += ours.decode_us;
  all.packed_bytes += ours.packed_bytes;
  all.raw_bytes += ours.raw_bytes;
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s DIR [DIR ...]   folders of 16-bit PNG files\n", argv[0]);
    return 2;
  }
  int worst = 0;
  Sum all;
  for (int i = 1; i < argc; ++i) worst = std::max(worst, Measure(argv[i], all));
  if (all.packed_bytes > 0) {
    std::printf("all folders together\n");
    Print("MixStage depth codec", all);
  }
  return worst;
}
