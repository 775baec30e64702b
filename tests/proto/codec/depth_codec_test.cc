// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/depth_codec.h"

#include <gtest/gtest.h>

#include <random>

namespace mixstage {
namespace {

cv::Mat1w Noise(int width, int height, unsigned seed, int spread) {
  std::mt19937 random(seed);
  cv::Mat1w picture(height, width);
  for (auto& value : picture) value = static_cast<std::uint16_t>(random() % static_cast<unsigned>(spread));
  return picture;
}

bool Same(const cv::Mat1w& a, const cv::Mat1w& b) {
  return a.size() == b.size() && cv::countNonZero(a != b) == 0;
}

TEST(DepthCodec, DecodeUndoesEncodeForAnyWidthAndAnyValue) {
  DepthEncoder encoder;
  DepthDecoder decoder;
  std::vector<std::uint8_t> bytes;
  for (int width = 1; width <= 67; ++width) {
    const cv::Mat1w picture = Noise(width, 5, static_cast<unsigned>(width), 65536);
    encoder.Encode(View(picture), bytes);
    cv::Mat1w back;
    ASSERT_TRUE(decoder.Decode(bytes, back)) << width;
    ASSERT_TRUE(Same(picture, back)) << width;
  }
}

TEST(DepthCodec, TakesAPictureInsideAnother) {
  const cv::Mat1w whole = Noise(64, 48, 1, 4000);
  const cv::Mat1w part = whole(cv::Rect(5, 7, 31, 20));
  std::vector<std::uint8_t> bytes;
  DepthEncoder().Encode(View(part), bytes);
  cv::Mat1w back;
  ASSERT_TRUE(DepthDecoder().Decode(bytes, back));
  EXPECT_TRUE(Same(part, back));
}

TEST(DepthCodec, SmoothSurfacesShrinkAtLeastFivefold) {
  cv::Mat1w ramp(144, 176);
  for (int y = 0; y < ramp.rows; ++y) {
    for (int x = 0; x < ramp.cols; ++x) ramp(y, x) = static_cast<std::uint16_t>(4000 + 3 * x + y);
  }
  std::vector<std::uint8_t> bytes;
  DepthEncoder().Encode(View(ramp), bytes);
  EXPECT_LT(bytes.size() * 5, ramp.total() * 2);
}

TEST(DepthCodec, EveryTruncationIsRefused) {
  const cv::Mat1w picture = Noise(40, 30, 2, 900);
  std::vector<std::uint8_t> bytes;
  DepthEncoder().Encode(View(picture), bytes);
  DepthDecoder decoder;
  cv::Mat1w back;
  for (std::size_t n = 0; n < bytes.size(); ++n) {
    ASSERT_FALSE(decoder.Decode(std::span(bytes).first(n), back)) << n;
  }
}

TEST(DepthCodec, DamageIsRefusedOrDecodesToTheStatedSize) {
  const cv::Mat1w picture = Noise(40, 30, 3, 900);
  std::vector<std::uint8_t> good;
  DepthEncoder().Encode(View(picture), good);
  DepthDecoder decoder;
  std::mt19937 random(4);
  for (int i = 0; i < 3000; ++i) {
    std::vector<std::uint8_t> bad = good;
    for (int k = 0; k < 3; ++k) bad[random() % bad.size()] = static_cast<std::uint8_t>(random());
    cv::Mat1w back;
    if (decoder.Decode(bad, back)) {
      ASSERT_EQ(back.size(), cv::Size(bad[4] | bad[5] << 8, bad[6] | bad[7] << 8));
    }
  }
}

TEST(DepthCodec, ABombIsRefusedByItsHeader) {
  // 8192 x 8192 in the header: over the pixel limit; 4096 x 4096 with a stream that states less: a lie.
  std::vector<std::uint8_t> bytes;
  DepthEncoder().Encode(View(cv::Mat1w(cv::Mat1w::zeros(16, 16))), bytes);
  DepthDecoder decoder;
  cv::Mat1w back;
  bytes[5] = bytes[7] = 0x20;
  bytes[4] = bytes[6] = 0;
  EXPECT_FALSE(decoder.Decode(bytes, back));
  bytes[5] = bytes[7] = 0x10;
  EXPECT_FALSE(decoder.Decode(bytes, back));
  EXPECT_TRUE(back.empty());
}

}  // namespace
}  // namespace mixstage
