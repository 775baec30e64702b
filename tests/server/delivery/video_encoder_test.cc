// SPDX-License-Identifier: Apache-2.0
#include "server/delivery/video_encoder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "server/delivery/depth_packer.h"
#include "server/delivery/h264.h"
#include "viewer_client/native/stream_decoder.h"

namespace mixstage {
namespace {

constexpr std::int64_t kPictureUs = 33'333;

// A smooth wall with some texture and a body that walks past it.
YuvImage ColorScene(int width, int height, int i) {
  YuvImage image;
  image.Create(width, height, ChromaLayout::k420);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double dx = (x - 0.3 * width - 2.0 * i) / (0.1 * width),
                   dy = (y - 0.5 * height) / (0.35 * height);
      const double wall = 130 + 50 * std::sin(x * 0.05) * std::cos(y * 0.04);
      image.y(y, x) = cv::saturate_cast<std::uint8_t>(dx * dx + dy * dy < 1 ? 20 + x % 16 : wall);
    }
  }
  for (int y = 0; y < image.cb.rows; ++y) {
    for (int x = 0; x < image.cb.cols; ++x) {
      image.cb(y, x) = cv::saturate_cast<std::uint8_t>(60 + x / 4);
      image.cr(y, x) = cv::saturate_cast<std::uint8_t>(200 - y / 4);
    }
  }
  return image;
}

// The same as depth: a body at 3 m before a wall at 4.5 m and a floor that comes nearer.
cv::Mat1f DepthScene(int width, int height, int i) {
  cv::Mat1f depth(height, width);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double dx = (x - 0.3 * width - 2.0 * i) / (0.1 * width),
                   dy = (y - 0.5 * height) / (0.35 * height);
      const double r = dx * dx + dy * dy;
      const double room = y < 0.65 * height ? 4.5 : 4.5 - 2.5 * (y - 0.65 * height) / (0.35 * height);
      depth(y, x) = static_cast<float>(r < 1 ? 3.05 - 0.1 * std::sqrt(1 - r) : room);
    }
  }
  return depth;
}

double Psnr(const cv::Mat1b& a, const cv::Mat1b& b) {
  double sum = 0;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) sum += std::pow(a(y, x) - b(y, x), 2);
  }
  return 10 * std::log10(255.0 * 255.0 * static_cast<double>(a.total()) / std::max(sum, 1e-9));
}

WatchPictureView ViewOf(const EncodedPicture& encoded, WatchStream stream, const DepthRange& range = {0, 0}) {
  return {{.stream = stream, .key_frame = encoded.key_frame, .near_m = range.near_m, .far_m = range.far_m},
          encoded.access_unit};
}

TEST(VideoEncoder, ColourComesBackAlmostTheSame) {
  auto encoder = VideoEncoder::Create({}, 640, 480);
  ASSERT_TRUE(encoder) << encoder.error().message;
  StreamDecoder decoder = *StreamDecoder::Create();
  ColorPicture decoded;
  for (int i = 0; i < 20; ++i) {
    const YuvImage image = ColorScene(640, 480, i);
    const auto encoded = encoder->Encode(image, i * kPictureUs);
    ASSERT_TRUE(encoded) << encoded.error().message;
    ASSERT_EQ(decoder.DecodeColor(ViewOf(*encoded, WatchStream::kColor), &decoded), DecodeOutcome::kPicture)
        << i;
    // 4 Mb/s for a picture of this kind is far beyond what is seen: 38 dB is "no visible difference".
    EXPECT_GT(Psnr(image.y, decoded.image.y), 38) << i;
    EXPECT_GT(Psnr(image.cb, decoded.image.cb), 40) << i;
    EXPECT_GT(Psnr(image.cr, decoded.image.cr), 40) << i;
  }
}

TEST(VideoEncoder, DepthAtTwoMegabitIsWithinEightMillimetresAtThreeMetres) {
  auto encoder = VideoEncoder::Create(
      {.format = VideoFormat::kDepth10, .preset = EncoderPreset::kSuperfast, .bitrate_bps = 2'000'000}, 1024,
      768);
  ASSERT_TRUE(encoder) << encoder.error().message;
  StreamDecoder decoder = *StreamDecoder::Create();
  DepthRangeFit fit = *DepthRangeFit::Create({});
  WatchedDepth decoded;
  Yuv10Image planes;
  std::mt19937 random(5);
  std::normal_distribution<float> noise(0, 0.004f);
  std::size_t bytes = 0;
  const int pictures = 30;
  for (int i = 0; i < pictures; ++i) {
    cv::Mat1f depth = DepthScene(1024, 768, i);
    for (float& z : depth) z += noise(random);
    if (encoder->KeyFrameDue(i * kPictureUs)) fit.Update(View(depth));
    PackDepth(View(depth), {}, {}, fit.range(), &planes);
    const auto encoded = encoder->Encode(planes, i * kPictureUs);
    ASSERT_TRUE(encoded) << encoded.error().message;
    bytes += encoded->access_unit.size();
    ASSERT_EQ(decoder.DecodeDepth(ViewOf(*encoded, WatchStream::kDepth, fit.range()), &decoded),
              DecodeOutcome::kPicture);
    if (i < 5) continue;  // the rate control's start
    const cv::Mat1f truth = DepthScene(1024, 768, i);
    double sum = 0;
    int count = 0;
    for (int y = 0; y < 768; ++y) {
      for (int x = 0; x < 1024; ++x) {
        if (std::abs(truth(y, x) - 3.0f) > 0.1f) continue;
        const double error = decoded.depth_m(y, x) - depth(y, x);  // the sensor's noise is asked for too
        sum += error * error;
        ++count;
      }
    }
    ASSERT_GT(count, 10'000);
    EXPECT_LT(std::sqrt(sum / count), 0.008) << i;
  }
  EXPECT_LT(static_cast<double>(bytes) * 8 / (pictures / 30.0), 2.6e6) << "bits a second";
}

TEST(VideoEncoder, MatteAndLabelSurvive) {
  auto encoder = VideoEncoder::Create(
      {.format = VideoFormat::kDepth10, .preset = EncoderPreset::kSuperfast, .bitrate_bps = 2'000'000}, 320,
      240);
  StreamDecoder decoder = *StreamDecoder::Create();
  const cv::Mat1f depth = DepthScene(320, 240, 0);
  cv::Mat1b alpha(240, 320, std::uint8_t{0}), label(240, 320, std::uint8_t{0});
  alpha(cv::Rect(64, 40, 96, 160)) = 255;
  label(cv::Rect(200, 160, 80, 64)) = 2;
  Yuv10Image planes;
  PackDepth(View(depth), View(alpha), View(label), {1, 6}, &planes);
  const auto encoded = encoder->Encode(planes, 0);
  ASSERT_TRUE(encoded);
  WatchedDepth decoded;
  ASSERT_EQ(decoder.DecodeDepth(ViewOf(*encoded, WatchStream::kDepth, {1, 6}), &decoded),
            DecodeOutcome::kPicture);
  EXPECT_GT(decoded.alpha(60, 56), 240);  // inside
  EXPECT_LT(decoded.alpha(10, 10), 15);
  EXPECT_EQ(CodeToLabel(decoded.label_codes(96, 120)), WatchLabel::kShadow);
  EXPECT_EQ(CodeToLabel(decoded.label_codes(20, 20)), WatchLabel::kScene);
}

TEST(VideoEncoder, KeyFramesComeByTheClockAndOnDemandAndNeverElse) {
  auto encoder = VideoEncoder::Create({.key_frame_interval_s = 0.5}, 320, 240);
  std::vector<int> key_frames;
  for (int i = 0; i < 40; ++i) {
    YuvImage image = ColorScene(320, 240, i);
    if (i == 10) image.y.setTo(255);  // a cut is no reason
    if (i == 20) encoder->RequestKeyFrame();
    const bool due = encoder->KeyFrameDue(i * kPictureUs);
    const auto encoded = encoder->Encode(image, i * kPictureUs);
    ASSERT_TRUE(encoded);
    EXPECT_EQ(encoded->key_frame, due) << i;
    EXPECT_EQ(AvcCodecString(encoded->access_unit).has_value(), encoded->key_frame)
        << "SPS before key frames only";
    if (encoded->key_frame) key_frames.push_back(i);
  }
  EXPECT_EQ(key_frames, (std::vector<int>{0, 16, 20, 36}));
}

TEST(VideoEncoder, NamesTheCodecItProduces) {
  auto color = VideoEncoder::Create({}, 1024, 768);
  EXPECT_EQ(color->codec(), "");
  ASSERT_TRUE(color->Encode(ColorScene(1024, 768, 0), 0));
  EXPECT_TRUE(color->codec().starts_with("avc1.42C0") || color->codec().starts_with("avc1.64"))
      << color->codec();
  auto depth = VideoEncoder::Create({.format = VideoFormat::kDepth10}, 1024, 768);
  Yuv10Image planes;
  PackDepth(View(DepthScene(1024, 768, 0)), {}, {}, {1, 6}, &planes);
  ASSERT_TRUE(depth->Encode(planes, 0));
  EXPECT_TRUE(depth->codec().starts_with("avc1.6E00")) << depth->codec();
}

TEST(VideoEncoder, ReadsPlanesThatArePartsOfLargerOnes) {
  const YuvImage large = ColorScene(400, 300, 0);
  YuvImage part;
  part.layout = ChromaLayout::k420;
  part.y = large.y(cv::Rect(32, 16, 320, 240));
  part.cb = large.cb(cv::Rect(16, 8, 160, 120));
  part.cr = large.cr(cv::Rect(16, 8, 160, 120));
  auto encoder = VideoEncoder::Create({}, 320, 240);
  StreamDecoder decoder = *StreamDecoder::Create();
  ColorPicture decoded;
  const auto encoded = encoder->Encode(part, 0);
  ASSERT_TRUE(encoded);
  ASSERT_EQ(decoder.DecodeColor(ViewOf(*encoded, WatchStream::kColor), &decoded), DecodeOutcome::kPicture);
  EXPECT_GT(Psnr(part.y, decoded.image.y), 35);
  EXPECT_GT(Psnr(part.cr, decoded.image.cr), 35);
}

TEST(VideoEncoder, OddSizesLoseTheirLastColumnAndRow) {
  auto encoder = VideoEncoder::Create({}, 321, 241);
  ASSERT_TRUE(encoder) << encoder.error().message;
  EXPECT_EQ(encoder->width(), 320);
  EXPECT_EQ(encoder->height(), 240);
  EXPECT_TRUE(encoder->Encode(ColorScene(321, 241, 0), 0));
}

TEST(VideoEncoder, ConfigurationIsCheckedByName) {
  const auto refusal = [](const VideoEncoderConfig& config, int width) {
    const auto encoder = VideoEncoder::Create(config, width, 240);
    return encoder ? std::string() : encoder.error().message;
  };
  EXPECT_NE(refusal({.bitrate_bps = 5}, 320).find("bitrate_bps"), std::string::npos);
  EXPECT_NE(refusal({.key_frame_interval_s = 0}, 320).find("key_frame_interval_s"), std::string::npos);
  EXPECT_NE(refusal({.fps = std::nan("")}, 320).find("fps"), std::string::npos);
  EXPECT_NE(refusal({}, 8).find("8x240"), std::string::npos);
  EXPECT_FALSE(ParseEncoderPreset("placebo"));
  EXPECT_EQ(*ParseEncoderPreset("superfast"), EncoderPreset::kSuperfast);
}

TEST(StreamDecoder, StartsOnlyAtAKeyFrameAndAgainAfterDamage) {
  auto encoder = VideoEncoder::Create({}, 320, 240);
  StreamDecoder decoder = *StreamDecoder::Create();
  ColorPicture decoded;
  std::vector<std::vector<std::uint8_t>> units;
  std::vector<bool> keys;
  for (int i = 0; i < 6; ++i) {
    if (i == 4) encoder->RequestKeyFrame();
    const auto encoded = encoder->Encode(ColorScene(320, 240, i), i * kPictureUs);
    units.emplace_back(encoded->access_unit.begin(), encoded->access_unit.end());
    keys.push_back(encoded->key_frame);
  }
  const auto decode = [&](std::size_t i) {
    return decoder.DecodeColor({{.stream = WatchStream::kColor, .key_frame = keys[i]}, units[i]}, &decoded);
  };
  EXPECT_EQ(decode(1), DecodeOutcome::kWaiting);
  EXPECT_EQ(decode(0), DecodeOutcome::kPicture);
  EXPECT_EQ(decode(1), DecodeOutcome::kPicture);
  units[2].assign(100, 0xAB);
  EXPECT_EQ(decode(2), DecodeOutcome::kUndecodable);
  EXPECT_EQ(decode(3), DecodeOutcome::kUndecodable) << "predicted from the damaged one";
  EXPECT_EQ(decode(4), DecodeOutcome::kPicture);
  EXPECT_EQ(decode(5), DecodeOutcome::kPicture);
  decoder.Reset();
  EXPECT_EQ(decode(5), DecodeOutcome::kWaiting);
}

TEST(StreamDecoder, ChangedBytesNeverCrashIt) {
  auto encoder = VideoEncoder::Create({}, 160, 128);
  StreamDecoder decoder = *StreamDecoder::Create();
  std::mt19937 random(11);
  ColorPicture decoded;
  int undecodable = 0;
  for (int i = 0; i < 300; ++i) {
    encoder->RequestKeyFrame();
    const auto encoded = encoder->Encode(ColorScene(160, 128, i), i * kPictureUs);
    ASSERT_TRUE(encoded);
    std::vector<std::uint8_t> unit(encoded->access_unit.begin(), encoded->access_unit.end());
    for (int k = 0; k < 4; ++k) unit[random() % unit.size()] = static_cast<std::uint8_t>(random());
    unit.resize(1 + random() % unit.size());
    const WatchPictureView view{{.stream = WatchStream::kColor, .key_frame = true}, unit};
    if (decoder.DecodeColor(view, &decoded) == DecodeOutcome::kUndecodable) ++undecodable;
  }
  EXPECT_GT(undecodable, 100);
}

}  // namespace
}  // namespace mixstage
