// SPDX-License-Identifier: Apache-2.0
#include "server/depth/surface_cut.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "server/depth/surface_rows.h"

namespace mixstage::depth {
namespace {

DepthCamera Camera(int width, int height, double focal) {
  DepthCamera depth;
  depth.camera = {.width = width,
                  .height = height,
                  .fx = focal,
                  .fy = focal,
                  .cx = (width - 1) / 2.0,
                  .cy = (height - 1) / 2.0};
  depth.measures = DepthMeasure::kZ;
  depth.unit_m = 0.00025;
  return depth;
}
DepthCamera Coarse() { return Camera(176, 144, 220); }

cv::Mat1w Counts(const DepthCamera& depth, const std::function<double(double, double)>& z_of_ray) {
  cv::Mat1w raw(depth.camera.height, depth.camera.width);
  for (int y = 0; y < raw.rows; ++y) {
    for (int x = 0; x < raw.cols; ++x) {
      const double z =
          z_of_ray((x - depth.camera.cx) / depth.camera.fx, (y - depth.camera.cy) / depth.camera.fy);
      raw(y, x) = static_cast<std::uint16_t>(std::clamp(std::lround(z / depth.unit_m), 0l, 65535l));
    }
  }
  return raw;
}

struct Cut {
  explicit Cut(const DepthCamera& depth) : signal(*DepthSignal::Create(depth, 20)), cut(signal, {}) {}
  void Run(const cv::Mat1w& raw, const cv::Mat1w& amplitude = {}) {
    cut.Run(signal, View(raw), View(amplitude));
  }
  // Share of cells that are whole, in the columns and rows given.
  [[nodiscard]] double Whole(int x0, int y0, int x1, int y1) const {
    int whole = 0;
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) whole += (cut.cells().row(y)[x] & kWhole) == kWhole;
    }
    return whole / static_cast<double>((x1 - x0) * (y1 - y0));
  }
  DepthSignal signal;
  SurfaceCut cut;
};

TEST(SurfaceRows, VectorCodeGivesTheScalarBitsOnEveryWidth) {
  std::mt19937 random(1);
  std::uniform_real_distribution<float> z(1.0f, 1.2f);
  for (int width = 0; width < 68; ++width) {
    const GridShape shape{width, 5};
    GridPicture<float> picture(shape), limit(shape), scalar(shape), vector(shape);
    GridPicture<std::uint8_t> scalar_cut(shape), vector_cut(shape);
    for (int y = 0; y < 5; ++y) {
      for (int x = 0; x < width; ++x) {
        picture.row(y)[x] = random() % 6 == 0 ? 0.0f : z(random) + (x > width / 2 ? 0.5f : 0.0f);
        limit.row(y)[x] = 0.05f * z(random);
      }
    }
    for (int y = 0; y < 5; ++y) {
      MedianRowScalar(picture.row(y - 1), picture.row(y), picture.row(y + 1), width, scalar.row(y));
      MedianRow(picture.row(y - 1), picture.row(y), picture.row(y + 1), width, vector.row(y));
      EXPECT_TRUE(std::equal(scalar.row(y), scalar.row(y) + width, vector.row(y))) << width;
      for (const std::ptrdiff_t next : {std::ptrdiff_t{1}, shape.stride()}) {
        if (next != 1 && y == 4) continue;
        CutRowScalar(picture.row(y), limit.row(y), next, 0.02f, width, scalar_cut.row(y));
        CutRow(picture.row(y), limit.row(y), next, 0.02f, width, vector_cut.row(y));
        EXPECT_TRUE(std::equal(scalar_cut.row(y), scalar_cut.row(y) + width, vector_cut.row(y))) << width;
      }
    }
  }
}

TEST(SurfaceRows, MedianIsTheMiddleOfNine) {
  std::mt19937 random(2);
  const GridShape shape{3, 3};
  for (int round = 0; round < 500; ++round) {
    std::vector<float> values;
    for (int i = 0; i < 9; ++i) values.push_back(1.0f + static_cast<float>(random() % 7));
    GridPicture<float> picture(shape), median(shape);
    for (int i = 0; i < 9; ++i) picture.row(i / 3)[i % 3] = values[static_cast<std::size_t>(i)];
    MedianRowScalar(picture.row(0), picture.row(1), picture.row(2), 3, median.row(1));
    std::sort(values.begin(), values.end());
    EXPECT_EQ(median.row(1)[1], values[4]);
  }
}

TEST(SurfaceCut, NoiseTearsNoWallAndHidesNoStepOf40cm) {
  const DepthCamera depth = Coarse();
  // From a good sensor to a ToF camera on dark cloth at 5 m; 0.4 m is what an actor stands before the wall.
  for (const double sigma_m : {0.0, 0.01, 0.03, 0.06, 0.09}) {
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0, 1);
    auto actor = [](double x, double y) { return std::abs(x) < 0.08 && y > -0.2; };
    Cut cut(depth);
    cut.Run(Counts(depth,
                   [&](double x, double y) { return (actor(x, y) ? 4.6 : 5.0) + sigma_m * noise(random); }));
    EXPECT_GT(cut.Whole(2, 2, 60, 140), 0.985) << sigma_m;
    EXPECT_GT(cut.Whole(80, 60, 96, 140), 0.96) << sigma_m;
    // Cells across the silhouette: column 70 is wall, 72 is actor (0.08 * 220 = 17.6 left of 87.5: 69.9).
    int joined = 0;
    for (int y = 60; y < 140; ++y) joined += (cut.cut.cells().row(y)[69] & kWhole) != 0;
    // Of 80; the last is a step of 4.4 standard deviations, most of which must still be seen.
    EXPECT_LE(joined, sigma_m < 0.05 ? 0 : sigma_m < 0.08 ? 4 : 24) << sigma_m;
  }
}

TEST(SurfaceCut, FloorsAndCreasesAreNoSteps) {
  const DepthCamera depth = Coarse();
  // A floor 1.4 m below the camera up to a wall at 5.5 m: 76 mm a row at its far end.
  Cut cut(depth);
  cut.Run(Counts(depth, [](double, double y) { return y > 0 ? std::min(5.5, 1.4 / y) : 5.5; }));
  EXPECT_EQ(cut.Whole(1, 1, 174, 142), 1.0);
}

TEST(SurfaceCut, StairsOfAQuantisingSensorAreNoSteps) {
  // A triangulating sensor: disparity in eighths of a pixel, 0.075 m x 570 px; a slanted wall from 3 to 6 m.
  const DepthCamera depth = Camera(320, 240, 285);
  Cut cut(depth);
  cut.Run(Counts(depth, [](double x, double) {
    const double z = 4.2 / (1 - 0.6 * x);
    return 0.075 * 570 / (std::round(8 * 0.075 * 570 / z) / 8);
  }));
  EXPECT_GT(cut.Whole(2, 2, 317, 237), 0.995);
}

TEST(SurfaceCut, MixedPixelsBelongToNoSurface) {
  const DepthCamera depth = Coarse();
  // Column 80 mixes both sides half and half; 20 mm noise.
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0, 0.02);
  cv::Mat1w raw = Counts(depth, [&](double x, double) { return (x < -0.036 ? 3.0 : 4.0) + noise(random); });
  for (int y = 0; y < raw.rows; ++y) raw(y, 80) = static_cast<std::uint16_t>(3.5 / depth.unit_m);
  Cut cut(depth);
  cut.Run(raw);
  int drawn = 0;
  for (int y = 2; y < 140; ++y) {
    drawn += (cut.cut.cells().row(y)[79] & kWhole) != 0;
    drawn += (cut.cut.cells().row(y)[80] & kWhole) != 0;
  }
  EXPECT_EQ(drawn, 0);
  EXPECT_GT(cut.Whole(2, 2, 78, 140), 0.98);
  EXPECT_GT(cut.Whole(82, 2, 174, 140), 0.98);
}

TEST(SurfaceCut, ASpuriousPixelIsDroppedAlone) {
  const DepthCamera depth = Coarse();
  cv::Mat1w raw = Counts(depth, [](double, double) { return 3.0; });
  raw(50, 60) = static_cast<std::uint16_t>(1.0 / depth.unit_m);
  Cut cut(depth);
  cut.Run(raw);
  EXPECT_EQ(cut.cut.valid().row(50)[60], 0);
  EXPECT_EQ(cut.cut.valid().row(50)[61], 255);
  EXPECT_EQ(cut.cut.valid().row(49)[60], 255);
}

TEST(SurfaceCut, AmplitudeTellsTheNoisyPixelsFromTheGoodOnes) {
  const DepthCamera depth = Coarse();
  // Left: bright, 10 mm. Right: dark, 100 mm, at the same distance.
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 1);
  cv::Mat1w amplitude(depth.camera.height, depth.camera.width, std::uint16_t{2000});
  amplitude.colRange(88, 176) = 100;
  amplitude(70, 30) = 0;
  Cut cut(depth);
  cut.Run(Counts(depth, [&](double x, double) { return 4 + noise(random) * (x < 0 ? 0.01 : 0.1); }),
          amplitude);
  const SurfaceNoise& measured = cut.cut.noise();
  EXPECT_NEAR(measured.pixel_m[static_cast<std::size_t>(AmplitudeClass(2000))], 0.01, 0.003);
  EXPECT_NEAR(measured.pixel_m[static_cast<std::size_t>(AmplitudeClass(100))], 0.1, 0.03);
  EXPECT_GT(cut.Whole(92, 2, 174, 140), 0.97);
  EXPECT_EQ(cut.cut.valid().row(70)[30], 0) << "nothing came back there";
}

TEST(NoiseClasses, RiseWithTheirQuantityAndStayInside) {
  EXPECT_EQ(AmplitudeClass(0), 0);
  EXPECT_EQ(AmplitudeClass(1), 0);
  EXPECT_EQ(AmplitudeClass(2), 4);
  EXPECT_EQ(AmplitudeClass(65535), 63);
  EXPECT_EQ(DepthClass(0.0f), 0);
  EXPECT_EQ(DepthClass(1.0f), 24);
  EXPECT_EQ(DepthClass(2.0f), 28);
  EXPECT_EQ(DepthClass(1e9f), 63);
}

}  // namespace
}  // namespace mixstage::depth
