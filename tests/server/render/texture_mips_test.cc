// SPDX-License-Identifier: Apache-2.0
#include "server/render/texture_mips.h"

#include <gtest/gtest.h>

#include "proto/base/srgb.h"

namespace mixstage {
namespace {

Texture RandomTexture(int width, int height) {
  Texture texture;
  texture.rgba = cv::Mat4b(height, width);
  cv::RNG rng(11);
  rng.fill(texture.rgba, cv::RNG::UNIFORM, 0, 256);
  for (cv::Vec4b& p : texture.rgba) p[3] = 255;
  return texture;
}

double Mean(const TextureMips::Level& level, int channel) {
  double sum = 0;
  for (int y = 0; y < level.height; ++y) {
    for (int x = 0; x < level.width; ++x) sum += level.texel(x, y)[channel];
  }
  return sum / (level.width * level.height) / 65535.0;
}

TEST(TextureMips, EveryLevelKeepsTheMean) {
  for (const auto& [width, height] : {std::pair{64, 64}, {37, 5}, {1, 9}, {100, 75}}) {
    const TextureMips mips(RandomTexture(width, height));
    for (int channel = 0; channel < 3; ++channel) {
      const double mean = Mean(mips.levels()[0], channel);
      for (const TextureMips::Level& level : mips.levels()) EXPECT_NEAR(Mean(level, channel), mean, 2e-4);
    }
    EXPECT_EQ(mips.levels().back().width * mips.levels().back().height, 1);
  }
}

TEST(TextureMips, MeanIsTakenInLinearLight) {
  Texture texture;
  texture.rgba = cv::Mat4b(2, 2, cv::Vec4b(0, 0, 0, 255));
  texture.rgba(0, 0) = texture.rgba(1, 1) = {255, 255, 255, 255};
  const TextureMips mips(texture);
  EXPECT_NEAR(mips.Sample(0.3f, 0.3f, 100.0f)[0], 0.5f, 1e-4f);  // not the 0.21 of the mean of sRGB values
}

TEST(TextureMips, TexelCentresShowTheTexels) {
  const Texture texture = RandomTexture(8, 4);
  const TextureMips mips(texture);
  for (int y = 0; y < 4; ++y) {
    for (int x = 0; x < 8; ++x) {
      const Eigen::Array4f color =
          mips.Sample((static_cast<float>(x) + 0.5f) / 8, (static_cast<float>(y) + 0.5f) / 4, 1.0f);
      for (int c = 0; c < 3; ++c)
        EXPECT_NEAR(color[c], SrgbTables::Get().ToLinear(texture.rgba(y, x)[c]), 1e-4f);
    }
  }
}

TEST(TextureMips, EdgesWrapAsAsked) {
  Texture texture;
  texture.rgba = cv::Mat4b(1, 4, cv::Vec4b(0, 0, 0, 255));
  texture.rgba(0, 0) = {255, 255, 255, 255};
  auto at = [&](TextureWrap wrap, float u) {
    texture.wrap_u = wrap;
    return TextureMips(texture).Sample(u, 0.5f, 1.0f)[0];
  };
  EXPECT_NEAR(at(TextureWrap::kRepeat, 1.125f), 1.0f, 1e-4f);
  EXPECT_NEAR(at(TextureWrap::kRepeat, -0.875f), 1.0f, 1e-4f);
  EXPECT_NEAR(at(TextureWrap::kRepeat, 1.0f), 0.5f, 1e-4f);  // between the last and the first
  EXPECT_NEAR(at(TextureWrap::kClamp, -3.0f), 1.0f, 1e-4f);
  EXPECT_NEAR(at(TextureWrap::kClamp, 3.0f), 0.0f, 1e-4f);
  EXPECT_NEAR(at(TextureWrap::kMirror, -0.125f), 1.0f, 1e-4f);
  EXPECT_NEAR(at(TextureWrap::kMirror, 1.125f), 0.0f, 1e-4f);
  EXPECT_NEAR(at(TextureWrap::kMirror, 2.125f), 1.0f, 1e-4f);
}

TEST(TextureMips, InvisibleTexelsLendNoColour) {
  Texture texture;
  texture.rgba = cv::Mat4b(2, 2, cv::Vec4b(255, 0, 0, 255));
  texture.rgba(0, 0) = {0, 255, 0, 0};
  const Eigen::Array4f color = TextureMips(texture).Sample(0.5f, 0.5f, 100.0f);
  EXPECT_NEAR(color[0], 1.0f, 1e-4f);
  EXPECT_NEAR(color[1], 0.0f, 1e-4f);
  EXPECT_NEAR(color[3], 0.75f, 1e-4f);
}

TEST(TextureMips, GiantsAreHalvedOnce) {
  const TextureMips mips(RandomTexture(5000, 2));
  EXPECT_EQ(mips.levels()[0].width, 2500);
}

}  // namespace
}  // namespace mixstage
