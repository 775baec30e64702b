// SPDX-License-Identifier: Apache-2.0
//
// The vector kernels against the scalar ones that specify them, on every count up to a few vectors.
#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "server/render/interpolate.h"
#include "server/render/shade_lights.h"
#include "server/render/surface_color.h"
#include "server/render/surface_key.h"
#include "server/render/texture_mips.h"
#include "tests/server/render/test_scenes.h"

namespace mixstage {
namespace {

using Row = FragmentRows::Row;

// Triangles some metres in front of the camera, rays through them (some just beside).
FragmentRows RandomFragments(std::size_t count, int seed) {
  FragmentRows rows;
  rows.Resize(count);
  cv::RNG rng(static_cast<std::uint64_t>(seed));
  auto number = [&](double low, double high) { return static_cast<float>(rng.uniform(low, high)); };
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3f middle(number(-1, 1), number(-1, 1), number(1, 5));
    Eigen::Vector3f aim = Eigen::Vector3f::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3f p = middle + 0.05f * Eigen::Vector3f(number(-1, 1), number(-1, 1), number(-1, 1));
      aim += number(-0.1, 1) * (p - middle);
      const Eigen::Vector4f position(p.x(), p.y(), p.z(), number(-2, 2));
      const Eigen::Vector4f normal(number(-1, 1), number(-1, 1), number(0.1, 1), number(-2, 2));
      Eigen::Map<Eigen::Vector4f>(rows.corner(k) + 4 * i) = position;
      Eigen::Map<Eigen::Vector4f>(rows.corner(k + 3) + 4 * i) = normal;
    }
    aim += middle;
    rows.row(Row::kRayX)[i] = aim.x() / aim.z();
    rows.row(Row::kRayY)[i] = aim.y() / aim.z();
    rows.row(Row::kFront)[i] = i % 2 == 0 ? 1.0f : -1.0f;
    rows.row(Row::kTextureWidth)[i] = rows.row(Row::kTextureHeight)[i] = 64;
    rows.row(Row::kShininess)[i] = number(1, 100);
  }
  return rows;
}

void ExpectRowsNear(const FragmentRows& a, const FragmentRows& b, Row first, Row last, std::size_t count) {
  for (int r = first; r <= last; ++r) {
    for (std::size_t i = 0; i < count; ++i) {
      const float x = a.row(static_cast<Row>(r))[i];
      const float y = b.row(static_cast<Row>(r))[i];
      // Fused multiply-adds round differently; the quotients of small triangles carry it up.
      EXPECT_NEAR(x, y, 2e-3f * std::max(1.0f, std::abs(x)))
          << "row " << r << " fragment " << i << " of " << count;
    }
  }
}

TEST(RenderKernels, InterpolateMatchesItsSpecification) {
  for (std::size_t count = 0; count <= 67; ++count) {
    FragmentRows scalar = RandomFragments(count, 1);
    FragmentRows vector = scalar;
    InterpolateScalar(0.003f, count, scalar);
    Interpolate(0.003f, count, vector);
    ExpectRowsNear(scalar, vector, Row::kX, Row::kV, count);
    ExpectRowsNear(scalar, vector, Row::kWeight1, Row::kWeight2, count);
    for (std::size_t i = 0; i < count; ++i) {
      const float taps = scalar.row(Row::kTaps)[i];
      EXPECT_LE(std::abs(taps - vector.row(Row::kTaps)[i]), 1.0f);  // at a tie of rounding
      EXPECT_GE(taps, 1.0f);
      EXPECT_LE(taps, 4.0f);
    }
  }
}

TEST(RenderKernels, ShadeLightsMatchesItsSpecification) {
  CameraIllumination light;
  light.ambient = test::UnevenAmbient();
  using enum CameraLight::Kind;
  light.lights.push_back({kDirectional, {0, -0.6f, -0.8f}, {0, 0, 0}, {0.5f, 0.5f, 0.4f}, 0});
  light.lights.push_back({kPoint, {1, -1, 1}, {0, 0, 0}, {2, 1, 1}, 0});
  light.lights.push_back({kArea, {0, -2, 3}, {0, 1, 0}, {4, 5, 6}, 0.5f});
  for (std::size_t count = 0; count <= 67; ++count) {
    FragmentRows scalar = RandomFragments(count, 2);
    InterpolateScalar(0.003f, count, scalar);
    FragmentRows vector = scalar;
    ShadeLightsScalar(light, count, scalar);
    ShadeLights(light, count, vector);
    ExpectRowsNear(scalar, vector, Row::kDiffuseR, Row::kSpecularB, count);
  }
}

TEST(RenderKernels, SampleTexturesMatchesItsSpecification) {
  std::vector<TextureMips> textures;
  cv::RNG rng(3);
  for (const TextureWrap wrap : {TextureWrap::kRepeat, TextureWrap::kClamp, TextureWrap::kMirror}) {
    Texture texture;
    texture.rgba = cv::Mat4b(37, 64);
    rng.fill(texture.rgba, cv::RNG::UNIFORM, 0, 256);
    texture.wrap_u = texture.wrap_v = wrap;
    textures.emplace_back(texture);
  }
  for (std::size_t count = 0; count <= 67; ++count) {
    FragmentRows rows = RandomFragments(count, 4);
    InterpolateScalar(0.003f, count, rows);
    std::vector<const TextureMips*> chosen(count);
    for (std::size_t i = 0; i < count; ++i) chosen[i] = i % 4 == 3 ? nullptr : &textures[i % 4];
    std::vector<float> scalar(4 * count, -1.0f);
    std::vector<float> vector(4 * count, -2.0f);
    SampleTexturesScalar(chosen, rows, scalar.data());
    SampleTextures(chosen, rows, vector.data());
    for (std::size_t i = 0; i < 4 * count; ++i) EXPECT_NEAR(scalar[i], vector[i], 1e-4f) << i;
  }
}

TEST(RenderKernels, ColorSurfaceMatchesItsSpecification) {
  constexpr std::size_t kCount = 67;
  constexpr std::size_t kFloats = 4 * (kCount + FragmentRows::kPadding);
  FragmentRows rows;
  rows.Resize(kCount);
  cv::RNG rng(6);
  auto number = [&] { return static_cast<float>(rng.uniform(0.0, 1.0)); };
  std::vector<float> texture_rgba(kFloats);
  for (float& x : texture_rgba) x = number();
  for (std::size_t i = 0; i < kCount; ++i) {
    rows.row(Row::kShare)[i] = number();
    for (int r = Row::kDiffuseR; r <= Row::kSpecularB; ++r) rows.row(static_cast<Row>(r))[i] = number();
  }
  Material solid;
  solid.base_color = {0.2f, 0.5f, 0.9f};
  solid.metallic = 0.3f;
  Material masked = solid;
  masked.alpha_mask = true;
  masked.alpha_cutoff = 0.4f;
  // Two surfaces side by side: neither may touch the other's fragments in the end.
  for (std::size_t border = 0; border <= kCount; ++border) {
    std::vector<float> scalar(kFloats, -1.0f);
    std::vector<float> vector(kFloats, -2.0f);
    ColorSurfaceScalar(solid, 0, border, rows, texture_rgba.data(), scalar.data());
    ColorSurfaceScalar(masked, border, kCount, rows, texture_rgba.data(), scalar.data());
    ColorSurface(solid, 0, border, rows, texture_rgba.data(), vector.data());
    ColorSurface(masked, border, kCount, rows, texture_rgba.data(), vector.data());
    for (std::size_t i = 0; i < 4 * kCount; ++i)
      ASSERT_NEAR(scalar[i], vector[i], 1e-5f) << border << " " << i;
  }
}

TEST(SurfaceKey, IsOneForOneMaterialAndNormalsThatHardlyDiffer) {
  const SurfaceKey up({0, 0, 1}, 7);
  auto tilted = [](float degrees, int axis, std::uint32_t material) {
    const float angle = degrees * static_cast<float>(M_PI) / 180.0f;
    Eigen::Vector3f normal(0, 0, std::cos(angle));
    normal[axis] = std::sin(angle);
    return SurfaceKey(normal, material);
  };
  for (const int axis : {0, 1}) {
    for (const float sign : {-1.0f, 1.0f}) {
      EXPECT_TRUE(SurfaceKey::AreOne(up, tilted(sign * 12, axis, 7)));
      EXPECT_TRUE(SurfaceKey::AreOne(tilted(sign * 12, axis, 7), up));
      for (const float degrees : {20.0f, 90.0f, 180.0f}) {
        EXPECT_FALSE(SurfaceKey::AreOne(up, tilted(sign * degrees, axis, 7))) << degrees;
        EXPECT_FALSE(SurfaceKey::AreOne(tilted(sign * degrees, axis, 7), up)) << degrees;
      }
    }
  }
  EXPECT_FALSE(SurfaceKey::AreOne(up, tilted(0, 0, 6)));
  EXPECT_FALSE(SurfaceKey::AreOne(up, tilted(0, 0, 8)));
  EXPECT_FALSE(SurfaceKey::AreOne(up, up, up, tilted(90, 0, 7)));
  EXPECT_TRUE(SurfaceKey::AreOne(up, up, up, tilted(5, 1, 7)));
}

TEST(Interpolate, FindsAPointOfTheTriangle) {
  FragmentRows rows = RandomFragments(1, 5);
  const Eigen::Vector4f weights(0.2f, 0.3f, 0.5f, 0);
  Eigen::Vector4f point = Eigen::Vector4f::Zero();
  for (std::size_t k = 0; k < 3; ++k) {
    point += weights[static_cast<int>(k)] * Eigen::Map<const Eigen::Vector4f>(rows.corner(k));
  }
  rows.row(Row::kRayX)[0] = point.x() / point.z();
  rows.row(Row::kRayY)[0] = point.y() / point.z();
  InterpolateScalar(0.003f, 1, rows);
  EXPECT_NEAR(rows.row(Row::kZ)[0], point.z(), 1e-4f);
  EXPECT_NEAR(rows.row(Row::kU)[0], point[3], 1e-3f);
  EXPECT_NEAR(rows.row(Row::kWeight2)[0], 0.5f, 1e-3f);
}

}  // namespace
}  // namespace mixstage
