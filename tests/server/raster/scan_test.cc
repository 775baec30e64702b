// SPDX-License-Identifier: Apache-2.0
#include "server/raster/scan.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <random>

#include "server/raster/raster_lens.h"

namespace mixstage::raster {
namespace {

PinholeCamera RationalCamera() {
  return {.width = 320,
          .height = 240,
          .fx = 260,
          .fy = 255,
          .cx = 161.3,
          .cy = 118.4,
          .k1 = -0.2,
          .k2 = 0.05,
          .p1 = 0.001,
          .p2 = -0.0007,
          .k3 = 0.01,
          .k4 = 0.08,
          .k5 = 0.02,
          .k6 = 0.001};
}

struct Picture {
  Picture(int w, int h) : inverse_z(h, w + kRowPadding, 0.0f), triangle(h, w + kRowPadding, -1) {}
  cv::Mat1f inverse_z;
  cv::Mat1i triangle;
  [[nodiscard]] ScanTarget Target(int x0, int y0, int x1, int y1) {
    return {inverse_z.ptr<float>(),
            triangle.ptr<int>(),
            static_cast<std::ptrdiff_t>(inverse_z.step1()),
            x0,
            y0,
            x1,
            y1};
  }
};

std::vector<Eigen::Vector3f> RandomPoints(std::size_t count, std::mt19937& random) {
  std::uniform_real_distribution<float> side(-3.0f, 3.0f);
  std::uniform_real_distribution<float> forward(-0.5f, 6.0f);
  std::vector<Eigen::Vector3f> points(count);
  for (auto& p : points) p = {side(random), side(random), forward(random)};
  return points;
}

TEST(ProjectVertices, VectorCodeGivesTheScalarBitsForEveryRemainder) {
  std::mt19937 random(1);
  const RasterLens lens = RasterLens::Of(RationalCamera(), 0.05);
  Affine34 T;
  for (auto& row : T.m) {
    for (float& v : row) v = std::uniform_real_distribution<float>(-1, 1)(random);
  }
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  for (std::size_t count = 0; count < 68; ++count) {
    auto points = RandomPoints(count, random);
    if (count > 9)
      points[3] = {kNan, 0, 1}, points[5] = {0, kInf, 1}, points[7] = {1e30f, 1, 1}, points[9].setZero();
    std::vector<ProjectedVertex> scalar(count), vector(count);
    ProjectVerticesScalar(lens, T, points, scalar);
    ProjectVertices(lens, T, points, vector);
    EXPECT_TRUE(scalar == vector) << count;
  }
}

TEST(ProjectVertices, AgreesWithTheCameraToTheSubPixel) {
  std::mt19937 random(2);
  const PinholeCamera camera = RationalCamera();
  const RasterLens lens = RasterLens::Of(camera, 0.05);
  int seen = 0;
  for (const auto& p : RandomPoints(20'000, random)) {
    const ProjectedVertex v = lens.Project(p);
    const auto exact = p.z() >= 0.05f ? camera.Project(p.cast<double>()) : std::nullopt;
    if (v.outcode & (kNear | kNoPixel)) {
      // Without a pixel: behind, beyond the fold, or just at it.
      if (exact) {
        EXPECT_GT(p.head<2>().squaredNorm() / (p.z() * p.z()), lens.fold_r2 * 0.999f);
      }
      continue;
    }
    ASSERT_TRUE(exact);
    // Half a sub-pixel; far outside the picture single precision adds to it.
    const double tolerance = 0.0025 + 1e-6 * exact->norm();
    EXPECT_NEAR(v.x / 256.0, exact->x(), tolerance);
    EXPECT_NEAR(v.y / 256.0, exact->y(), tolerance);
    EXPECT_NEAR(v.inverse_z * p.z(), 1.0, 1e-6);
    const bool in_picture =
        exact->x() >= -0.5 && exact->x() <= 319.5 && exact->y() >= -0.5 && exact->y() <= 239.5;
    if (in_picture) {
      EXPECT_EQ(v.outcode, 0u) << "what is in the picture is in the view";
    }
    seen += in_picture;
  }
  EXPECT_GT(seen, 1000);
}

// Corners anywhere, of any size, some of them outside, on pixel centres, in one point or on one line.
ScanBatch RandomBatch(std::size_t triangles, int width, int height, std::mt19937& random,
                      std::vector<ProjectedVertex>& vertices, std::vector<std::uint32_t>& indices) {
  std::uniform_int_distribution<int> x(-20 * kSubPixels, (width + 20) * kSubPixels);
  std::uniform_int_distribution<int> y(-20 * kSubPixels, (height + 20) * kSubPixels);
  std::uniform_int_distribution<int> step(-9 * kSubPixels, 9 * kSubPixels);
  std::uniform_real_distribution<float> inverse_z(0.1f, 2.0f);
  vertices.clear();
  indices.clear();
  for (std::size_t t = 0; t < triangles; ++t) {
    ProjectedVertex a{x(random), y(random), inverse_z(random), 0};
    for (int k = 0; k < 3; ++k) {
      ProjectedVertex v{a.x + step(random), a.y + step(random), inverse_z(random), 0};
      if (t % 5 == 1) v.x &= ~0xff, v.y &= ~0xff;
      if (t % 7 == 2 && k == 2) v.x = vertices.back().x, v.y = vertices.back().y;
      if (t % 11 == 3) v.y = a.y;
      if (t % 17 == 4 && k == 1) v.outcode = kNoPixel;
      if (t % 19 == 5) v.outcode = kLeft;
      if (t % 23 == 6 && k == 0) v.outcode = kNotFinite;
      if (t % 29 == 7 && k == 0) v.x += 70 * kSubPixels;
      indices.push_back(static_cast<std::uint32_t>(vertices.size()));
      vertices.push_back(v);
    }
  }
  ScanBatch batch;
  batch.vertices = vertices;
  batch.indices = indices;
  return batch;
}

TEST(ScanTriangles, VectorCodeGivesTheScalarBitsOnEveryWidth) {
  std::mt19937 random(3);
  std::vector<ProjectedVertex> vertices;
  std::vector<std::uint32_t> indices;
  for (int width = 1; width < 68; ++width) {
    const int height = 1 + width / 2;
    ScanBatch batch =
        RandomBatch(static_cast<std::size_t>(10 * width + 3), width, height, random, vertices, indices);
    for (const Faces faces : {Faces::kBoth, Faces::kFrontOnly}) {
      batch.faces = faces;
      batch.mirrored = width % 2 == 0;
      batch.first_id = width;
      Picture scalar(width, height), vector(width, height);
      std::vector<std::uint32_t> scalar_split, vector_split;
      TouchedBox scalar_touched, vector_touched;
      // A clip that leaves a margin where the picture is wide enough.
      const int m = width > 8 ? 3 : 0;
      ScanTrianglesScalar(batch, scalar.Target(m, m / 2, width - 1 - m, height - 1), scalar_split,
                          scalar_touched);
      ScanTriangles(batch, vector.Target(m, m / 2, width - 1 - m, height - 1), vector_split, vector_touched);
      EXPECT_EQ(cv::norm(scalar.inverse_z, vector.inverse_z, cv::NORM_INF), 0) << width;
      EXPECT_EQ(cv::norm(scalar.triangle, vector.triangle, cv::NORM_INF), 0) << width;
      EXPECT_EQ(scalar_split, vector_split);
      EXPECT_EQ(std::memcmp(&scalar_touched, &vector_touched, sizeof(TouchedBox)), 0);
      if (m > 0) {
        EXPECT_EQ(cv::countNonZero(vector.inverse_z.colRange(width - m, vector.inverse_z.cols)), 0)
            << "nothing right of the clip";
      }
    }
  }
}

// A grid of quads with displaced corners that covers the picture and more; every pixel belongs to one
// triangle.
TEST(ScanTriangles, EveryPixelOfAMeshIsCoveredExactlyOnce) {
  std::mt19937 random(4);
  constexpr int kWidth = 90, kHeight = 70, kCell = 7 * kSubPixels, kCells = 16;
  for (int round = 0; round < 8; ++round) {
    // Displacements that keep corners on pixel centres in some rounds: edges then run through centres.
    std::uniform_int_distribution<int> shift(-2 * kSubPixels, 2 * kSubPixels);
    const int mask = round % 2 == 0 ? ~0 : ~(kSubPixels - 1);
    std::vector<ProjectedVertex> vertices;
    for (int j = 0; j <= kCells; ++j) {
      for (int i = 0; i <= kCells; ++i) {
        vertices.push_back(
            {((i - 1) * kCell + shift(random)) & mask, ((j - 1) * kCell + shift(random)) & mask, 0.5f, 0});
      }
    }
    cv::Mat1i covered(kHeight, kWidth, 0);
    auto draw = [&](int a, int b, int c) {
      std::vector<std::uint32_t> indices, split;
      for (const int v : {a, b, c}) indices.push_back(static_cast<std::uint32_t>(v));
      Picture picture(kWidth, kHeight);
      TouchedBox touched;
      ScanBatch batch;
      batch.vertices = vertices;
      batch.indices = indices;
      ScanTriangles(batch, picture.Target(0, 0, kWidth - 1, kHeight - 1), split, touched);
      EXPECT_TRUE(split.empty());
      for (int y = 0; y < kHeight; ++y) {
        for (int x = 0; x < kWidth; ++x) covered(y, x) += picture.triangle(y, x) == 0;
      }
    };
    for (int j = 0; j < kCells; ++j) {
      for (int i = 0; i < kCells; ++i) {
        const int a = j * (kCells + 1) + i, b = a + 1, c = a + kCells + 1, d = c + 1;
        // Both diagonals and both orders of corners occur.
        if ((i + j) % 2 == 0)
          draw(a, b, c), draw(d, b, c);
        else
          draw(a, b, d), draw(a, d, c);
      }
    }
    double fewest = 0, most = 0;
    cv::minMaxLoc(covered, &fewest, &most);
    EXPECT_EQ(fewest, 1) << round;
    EXPECT_EQ(most, 1) << round;
  }
}

TEST(InverseToDepth, IsTheReciprocalAndKeepsNothing) {
  for (std::size_t n = 0; n < 40; ++n) {
    std::vector<float> inverse(n), depth(n, -1.0f);
    for (std::size_t i = 0; i < n; ++i) inverse[i] = i % 3 == 0 ? 0.0f : 0.25f * static_cast<float>(i);
    InverseToDepth(inverse.data(), depth.data(), n);
    for (std::size_t i = 0; i < n; ++i) EXPECT_EQ(depth[i], i % 3 == 0 ? 0.0f : 1.0f / inverse[i]);
  }
}

}  // namespace
}  // namespace mixstage::raster
