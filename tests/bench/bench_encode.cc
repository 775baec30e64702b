// SPDX-License-Identifier: Apache-2.0
//
// What delivery costs per 1024x768 picture: core-ms by preset, bits and errors in the counters.
#include <benchmark/benchmark.h>

#include <cmath>
#include <random>

#include "proto/base/clock.h"
#include "server/delivery/depth_packer.h"
#include "server/delivery/video_encoder.h"

namespace mixstage {
namespace {

constexpr int kWidth = 1024, kHeight = 768, kPictures = 60;
constexpr std::int64_t kPictureUs = 33'333;

// A textured wall and floor with a textured body that walks: what a composite asks of an encoder.
std::vector<YuvImage> ColorPictures() {
  std::vector<YuvImage> pictures(kPictures);
  std::mt19937 random(1);
  cv::Mat1b noise(kHeight, kWidth);
  for (auto& pixel : noise) pixel = static_cast<std::uint8_t>(random() % 5);
  for (int i = 0; i < kPictures; ++i) {
    YuvImage& picture = pictures[static_cast<std::size_t>(i)];
    picture.Create(kWidth, kHeight, ChromaLayout::k420);
    const double body_x = 300 + 4.0 * i;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        const double dx = (x - body_x) / 110, dy = (y - 420) / 300.0;
        const double wall =
            120 + 40 * std::sin(x * 0.07) * std::cos(y * 0.05) + 15 * std::sin(x * 0.9 + y * 0.7);
        const double body = 90 + 50 * std::sin((x - body_x) * 0.2) * std::sin(y * 0.15);
        picture.y(y, x) = cv::saturate_cast<std::uint8_t>((dx * dx + dy * dy < 1 ? body : wall) +
                                                          noise(y, (x + 37 * i) % kWidth));
      }
    }
    picture.cb.setTo(120);
    picture.cr.setTo(136);
  }
  return pictures;
}

cv::Mat1f DepthPicture(int i) {
  cv::Mat1f depth(kHeight, kWidth);
  const double body_x = 300 + 4.0 * i;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const double dx = (x - body_x) / 110, dy = (y - 420) / 300.0, r = dx * dx + dy * dy;
      const double room = y < 500 ? 4.5 + 0.0005 * x : 4.5 - (y - 500) * 0.01;
      depth(y, x) = static_cast<float>(r < 1 ? 3.0 - 0.15 * std::sqrt(1 - r) : room);
    }
  }
  return depth;
}

template <typename Encode>
void Run(benchmark::State& state, const Encode& encode) {
  std::int64_t cpu_us = 0, bytes = 0, count = 0;
  for (auto _ : state) {
    const std::int64_t start_us = ThreadCpuMicros();
    bytes += static_cast<std::int64_t>(encode(count));
    cpu_us += ThreadCpuMicros() - start_us;
    ++count;
  }
  state.counters["core_ms"] = static_cast<double>(cpu_us) / 1e3 / static_cast<double>(count);
  state.counters["Mbps"] = static_cast<double>(bytes) * 8 * 30 / 1e6 / static_cast<double>(count);
}

void EncodeColor(benchmark::State& state) {
  const std::vector<YuvImage> pictures = ColorPictures();
  auto encoder =
      VideoEncoder::Create({.preset = static_cast<EncoderPreset>(state.range(0))}, kWidth, kHeight);
  Run(state, [&](std::int64_t i) {
    return encoder->Encode(pictures[static_cast<std::size_t>(i % kPictures)], i * kPictureUs)
        ->access_unit.size();
  });
}
BENCHMARK(EncodeColor)->ArgName("preset")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);

void EncodeDepth(benchmark::State& state) {
  std::vector<Yuv10Image> pictures(kPictures);
  DepthRangeFit fit = *DepthRangeFit::Create({});
  for (int i = 0; i < kPictures; ++i) {
    const cv::Mat1f depth = DepthPicture(i);
    if (i == 0) fit.Update(View(depth));
    PackDepth(View(depth), {}, {}, fit.range(), &pictures[static_cast<std::size_t>(i)]);
  }
  auto encoder = VideoEncoder::Create({.format = VideoFormat::kDepth10,
                                       .preset = static_cast<EncoderPreset>(state.range(0)),
                                       .bitrate_bps = 2'000'000},
                                      kWidth, kHeight);
  Run(state, [&](std::int64_t i) {
    return encoder->Encode(pictures[static_cast<std::size_t>(i % kPictures)], i * kPictureUs)
        ->access_unit.size();
  });
}
BENCHMARK(EncodeDepth)->ArgName("preset")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);

void PackFloatDepth(benchmark::State& state) {
  const cv::Mat1f depth = DepthPicture(0);
  const cv::Mat1b alpha(kHeight, kWidth, 200), label(kHeight, kWidth, std::uint8_t{2});
  Yuv10Image planes;
  Run(state, [&](std::int64_t) {
    PackDepth(View(depth), View(alpha), View(label), {1, 6}, &planes);
    return 0;
  });
}
BENCHMARK(PackFloatDepth)->Unit(benchmark::kMillisecond);

void PackMillimetreDepth(benchmark::State& state) {
  const cv::Mat1f depth_m = DepthPicture(0);
  cv::Mat1w depth;
  depth_m.convertTo(depth, CV_16U, 1000);
  const cv::Mat1b alpha(kHeight, kWidth, 200), label(kHeight, kWidth, std::uint8_t{2});
  Yuv10Image planes;
  Run(state, [&](std::int64_t) {
    PackDepth(View(depth), View(alpha), View(label), {1, 6}, &planes);
    return 0;
  });
}
BENCHMARK(PackMillimetreDepth)->Unit(benchmark::kMillisecond);

void FitRange(benchmark::State& state) {
  const cv::Mat1f depth = DepthPicture(0);
  DepthRangeFit fit = *DepthRangeFit::Create({});
  Run(state, [&](std::int64_t) {
    fit.Update(View(depth));
    return 0;
  });
}
BENCHMARK(FitRange)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace mixstage

BENCHMARK_MAIN();
