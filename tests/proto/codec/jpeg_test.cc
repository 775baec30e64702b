// SPDX-License-Identifier: Apache-2.0
#include "proto/codec/jpeg.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

namespace mixstage {
namespace {

cv::Mat3b SmoothPicture(int width, int height) {
  cv::Mat3b picture(height, width);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      picture(y, x) = {static_cast<std::uint8_t>(40 + 150 * x / width),
                       static_cast<std::uint8_t>(60 + 120 * y / height),
                       static_cast<std::uint8_t>(200 - 120 * x / width)};
    }
  }
  return picture;
}

std::vector<std::uint8_t> JpegOf(const cv::Mat3b& bgr, ChromaLayout layout) {
  std::vector<std::uint8_t> jpeg;
  EXPECT_TRUE(JpegEncoder().Encode(FromBgr(bgr, layout), 92, jpeg));
  return jpeg;
}

TEST(Jpeg, PlanesKeepTheirLayoutAndThePictureSurvives) {
  for (const ChromaLayout layout : {ChromaLayout::k444, ChromaLayout::k422, ChromaLayout::k420}) {
    const cv::Mat3b picture = SmoothPicture(101, 77);  // odd on purpose
    YuvImage image;
    ASSERT_TRUE(JpegDecoder().Decode(JpegOf(picture, layout), image));
    EXPECT_EQ(image.layout, layout);
    EXPECT_EQ(image.width(), 101);
    EXPECT_LT(cv::norm(ToBgr(image), picture, cv::NORM_L1) / (101.0 * 77.0 * 3.0), 2.0);
  }
}

TEST(Jpeg, AgreesWithOpenCvsDecoderInColour) {
  const cv::Mat3b picture = SmoothPicture(320, 240);
  const auto jpeg = JpegOf(picture, ChromaLayout::k420);
  YuvImage image;
  ASSERT_TRUE(JpegDecoder().Decode(jpeg, image));
  const cv::Mat3b theirs = cv::imdecode(jpeg, cv::IMREAD_COLOR);
  EXPECT_LT(cv::norm(ToBgr(image), theirs, cv::NORM_INF), 6);
}

TEST(Jpeg, GreyBecomesAPictureWithoutColour) {
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", cv::Mat1b(20, 30, std::uint8_t{90}), jpeg);
  YuvImage image;
  ASSERT_TRUE(JpegDecoder().Decode(jpeg, image));
  EXPECT_EQ(image.cb(10, 10), 128);
  EXPECT_NEAR(image.y(10, 10), 90, 2);
}

TEST(Jpeg, EveryTruncationIsRefused) {
  const auto jpeg = JpegOf(SmoothPicture(64, 48), ChromaLayout::k420);
  JpegDecoder decoder;
  YuvImage image;
  for (std::size_t n = 0; n + 2 < jpeg.size(); ++n) {
    ASSERT_FALSE(decoder.Decode(std::span(jpeg).first(n), image)) << n;
  }
}

TEST(Jpeg, ABombIsRefusedBeforeItIsDecoded) {
  auto jpeg = JpegOf(SmoothPicture(64, 48), ChromaLayout::k420);
  // SOF0: FF C0, length, precision, height, width
  for (std::size_t i = 0; i + 9 < jpeg.size(); ++i) {
    if (jpeg[i] == 0xFF && jpeg[i + 1] == 0xC0) {
      jpeg[i + 5] = jpeg[i + 7] = 0xEA;  // 60,000 x 60,000
      break;
    }
  }
  YuvImage image;
  const Status status = JpegDecoder().Decode(jpeg, image);
  ASSERT_FALSE(status);
  EXPECT_NE(status.error().message.find("over the limit"), std::string::npos) << status.error().message;
  EXPECT_TRUE(image.empty());
}

TEST(Jpeg, RandomDamageNeverCrashes) {
  const auto good = JpegOf(SmoothPicture(64, 48), ChromaLayout::k422);
  JpegDecoder decoder;
  std::mt19937 random(1);
  int refused = 0;
  for (int i = 0; i < 2000; ++i) {
    auto bad = good;
    for (int k = 0; k < 4; ++k) bad[random() % bad.size()] = static_cast<std::uint8_t>(random());
    YuvImage image;
    refused += !decoder.Decode(bad, image);
  }
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace mixstage
