// SPDX-License-Identifier: Apache-2.0
#include "server/composite/relight.h"

#include <gtest/gtest.h>

#include <cmath>

namespace mixstage {
namespace {

const cv::Rect kDimmed(4, 4, 8, 8);

LightMap HalfDimmed(cv::Size half) {
  LightMap map;
  map.room = cv::Mat3f(half, cv::Vec3f::all(1));
  map.actor = cv::Mat3f(half, cv::Vec3f::all(1));
  map.cg = cv::Mat3f(half, cv::Vec3f::all(1));
  map.touched = cv::Mat1b(1, 2, std::uint8_t{255});
  map.room(kDimmed).setTo(cv::Scalar::all(0.5));
  return map;
}

YuvImage Grey(int width, int height, std::uint8_t level) {
  YuvImage image;
  image.Create(width, height, ChromaLayout::k420);
  image.y.setTo(level);
  image.cb.setTo(128);
  image.cr.setTo(128);
  return image;
}

TEST(Relight, ScalesInLinearLightAndTouchesNothingElse) {
  const YuvImage color = Grey(40, 30, 188);  // 0.503 in linear light
  YuvImage lit;
  RelightPicture(HalfDimmed({20, 15}), {}, color, lit);
  EXPECT_NEAR(lit.y(14, 14), 137, 1);  // 0.2515
  EXPECT_EQ(lit.cb(7, 7), 128);
  for (int y = 0; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
      ASSERT_TRUE((x >= 7 && y >= 7 && x <= 24 && y <= 24) || lit.y(y, x) == 188) << x << " " << y;
}

TEST(Relight, TheActorHasAFactorOfHisOwn) {
  const YuvImage color = Grey(40, 30, 188);
  cv::Mat1b alpha(30, 40, std::uint8_t{0});
  alpha(cv::Rect(12, 12, 4, 4)).setTo(255);
  YuvImage lit;
  RelightPicture(HalfDimmed({20, 15}), View(std::as_const(alpha)), color, lit);
  EXPECT_EQ(lit.y(14, 14), 188);
  EXPECT_NEAR(lit.y(10, 10), 137, 1);
}

TEST(Relight, ColoredFactorsColor) {
  LightMap map = HalfDimmed({20, 15});
  map.room(kDimmed).setTo(cv::Scalar(0.5, 0.5, 1.0));
  YuvImage lit;
  RelightPicture(map, {}, Grey(40, 30, 188), lit);
  EXPECT_GT(lit.cb(7, 7), 140);
  EXPECT_LT(lit.cr(7, 7), 128);
  const cv::Vec3b picture = LightMapPicture(map, {}, {40, 30})(14, 14);
  EXPECT_EQ(picture, cv::Vec3b(255, 128, 128));
  const cv::Mat3b half = LightMapPicture(map, {}, {39, 29}, 2);
  ASSERT_EQ(half.size(), cv::Size(20, 15));
  EXPECT_EQ(half(7, 7), picture);
  EXPECT_EQ(OnWhite(half)(7, 7), cv::Vec3b(255, 188, 188));  // half the light in sRGB
  EXPECT_EQ(OnWhite(half)(0, 0), cv::Vec3b::all(255));
}

// Y'CbCr of a pixel whose R G B are scaled in linear light.
cv::Vec3f Scaled(const cv::Vec3f& code, const cv::Vec3f& factor) {
  constexpr float kOffset = 0.055f * 255;
  const float cb = code[1] - 128, cr = code[2] - 128;
  cv::Vec3f rgb(code[0] + 1.402f * cr, code[0] - 0.344136f * cb - 0.714136f * cr, code[0] + 1.772f * cb);
  for (int c = 0; c < 3; ++c) rgb[c] = std::pow(factor[c], 1 / 2.4f) * (rgb[c] + kOffset) - kOffset;
  const float y = 0.299f * rgb[0] + 0.587f * rgb[1] + 0.114f * rgb[2];
  return {y, 128 + 0.564334f * (rgb[2] - y), 128 + 0.713267f * (rgb[0] - y)};
}

// Every layout, and a last square that is neither whole nor even.
TEST(Relight, EveryPixelIsScaledAsOneByItself) {
  const cv::Size size(77, 45), half(39, 23);
  cv::RNG rng(5);
  LightMap map;
  map.room = cv::Mat3f(half, cv::Vec3f(0.2f, 0.5f, 0.9f));
  map.actor = cv::Mat3f(half, cv::Vec3f(1.0f, 0.05f, 0.6f));
  map.actor_bounds = {{}, half};
  map.touched = cv::Mat1b(2, 3, std::uint8_t{255});
  cv::Mat1b alpha(size);
  rng.fill(alpha, cv::RNG::UNIFORM, 0, 2);
  alpha *= 255;
  for (const ChromaLayout layout : {ChromaLayout::k444, ChromaLayout::k422, ChromaLayout::k420}) {
    YuvImage color, lit;
    color.Create(size.width, size.height, layout);
    rng.fill(color.y, cv::RNG::UNIFORM, 40, 216);
    rng.fill(color.cb, cv::RNG::UNIFORM, 100, 156);
    rng.fill(color.cr, cv::RNG::UNIFORM, 100, 156);
    RelightPicture(map, View(std::as_const(alpha)), color, lit);
    const int shift_x = ChromaShiftX(layout), shift_y = ChromaShiftY(layout);
    cv::Mat2f sum(color.cb.size(), cv::Vec2f(0, 0));
    cv::Mat1f count(color.cb.size(), 0.0f);
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        const int u = x >> shift_x, v = y >> shift_y;
        const cv::Vec3f code(color.y(y, x), color.cb(v, u), color.cr(v, u));
        const cv::Vec3f wanted = Scaled(code, alpha(y, x) != 0 ? map.actor(0, 0) : map.room(0, 0));
        ASSERT_NEAR(lit.y(y, x), wanted[0], 0.7) << x << " " << y;
        sum(v, u) += cv::Vec2f(wanted[1], wanted[2]);
        count(v, u) += 1;
      }
    }
    for (int v = 0; v < sum.rows; ++v) {
      for (int u = 0; u < sum.cols; ++u) {
        ASSERT_NEAR(lit.cb(v, u), sum(v, u)[0] / count(v, u), 0.7) << u << " " << v;
        ASSERT_NEAR(lit.cr(v, u), sum(v, u)[1] / count(v, u), 0.7) << u << " " << v;
      }
    }
  }
}

TEST(Relight, LayersKeepTheirCoverage) {
  LightMap map = HalfDimmed({20, 15});
  map.cg.setTo(cv::Scalar(0.25, 0.5, 1));
  map.cg_revision = 7;
  CgLayer layer;
  layer.bounds = {4, 4, 6, 6};
  layer.color = cv::Mat4f(6, 6, cv::Vec4f(0.4f, 0.4f, 0.4f, 0.5f));
  layer.depth_m = cv::Mat1f(6, 6, 1.0f);
  layer.object_id = cv::Mat1b(6, 6, std::uint8_t{1});
  CgLayer lit;
  RelightLayer(map, layer, lit);
  EXPECT_EQ(lit.drawing, 7u);
  EXPECT_EQ(lit.bounds, layer.bounds);
  const cv::Vec4f p = lit.color(3, 3);
  EXPECT_FLOAT_EQ(p[0], 0.1f);
  EXPECT_FLOAT_EQ(p[1], 0.2f);
  EXPECT_FLOAT_EQ(p[2], 0.4f);
  EXPECT_FLOAT_EQ(p[3], 0.5f);
}

}  // namespace
}  // namespace mixstage
