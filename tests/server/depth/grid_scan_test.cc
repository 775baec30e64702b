// SPDX-License-Identifier: Apache-2.0
#include "server/depth/grid_scan.h"

#include <gtest/gtest.h>

#include <random>

#include "server/depth/depth_grid.h"

namespace mixstage::depth {
namespace {

using raster::kRowPadding;
using raster::kSubPixels;

struct Picture {
  Picture(int w, int h) : inverse_z(h, w + kRowPadding, 0.0f), width(w) {}
  raster::ScanTarget Target() {
    return {inverse_z.ptr<float>(), nullptr, static_cast<std::ptrdiff_t>(inverse_z.step1()), 0, 0, width - 1,
            inverse_z.rows - 1};
  }
  [[nodiscard]] cv::Mat1f Seen() const { return inverse_z.colRange(0, width); }
  cv::Mat1f inverse_z;
  int width;
};

// (w + 1) x (h + 1) corners, row by row with padding behind each row.
struct Sheet {
  Sheet(int w, int h, int jitter, std::mt19937& random) : width(w), height(h), stride(w + 1 + 8) {
    corners.Resize(static_cast<std::size_t>(stride) * static_cast<std::size_t>(h + 1));
    std::uniform_int_distribution<int> shift(-jitter, jitter);
    std::uniform_real_distribution<float> inverse_z(0.2f, 1.0f);
    for (int y = 0; y <= h; ++y) {
      for (int x = 0; x <= w; ++x) {
        const auto i = static_cast<std::size_t>(y * stride + x);
        corners.x[i] = (x - 1) * 5 * kSubPixels + shift(random);
        corners.y[i] = (y - 1) * 5 * kSubPixels + shift(random);
        corners.inverse_z[i] = inverse_z(random);
      }
    }
    cells.assign(static_cast<std::size_t>(stride) * static_cast<std::size_t>(h) + 8, kWhole);
  }
  [[nodiscard]] CellRun Run(int first, int row, int count) const {
    auto at = [&](int dx, int dy) {
      const auto i = static_cast<std::size_t>((row + dy) * stride + first + dx);
      return CellRun::Corner{&corners.x[i], &corners.y[i], &corners.inverse_z[i], &corners.outcode[i]};
    };
    return {{at(0, 0), at(1, 0), at(0, 1), at(1, 1)},
            cells.data() + row * stride + first,
            static_cast<std::size_t>(count)};
  }
  int width, height, stride;
  GridCorners corners;
  std::vector<std::uint8_t> cells;
};

TEST(ScanCells, VectorCodeGivesTheScalarBitsOnEveryWidth) {
  std::mt19937 random(1);
  for (int width = 0; width < 68; ++width) {
    Sheet sheet(width, 6, 4 * kSubPixels, random);
    std::uniform_int_distribution<int> parts(0, 15), chance(0, 20);
    for (auto& cell : sheet.cells) cell = static_cast<std::uint8_t>(parts(random));
    for (auto& code : sheet.corners.outcode) {
      constexpr std::uint32_t kCodes[] = {raster::kNear, raster::kNoPixel, raster::kLeft, raster::kNotFinite};
      const auto c = static_cast<std::size_t>(chance(random));
      code = c < 4 ? static_cast<std::int32_t>(kCodes[c]) : 0;
    }
    if (width > 3) sheet.corners.x[3] += 100 * kSubPixels;
    Picture scalar(5 * width / 2 + 3, 24), vector(5 * width / 2 + 3, 24);
    for (int y = 0; y < sheet.height; ++y) {
      ScanCellsScalar(sheet.Run(0, y, width), scalar.Target());
      ScanCells(sheet.Run(0, y, width), vector.Target());
    }
    EXPECT_EQ(cv::norm(scalar.Seen(), vector.Seen(), cv::NORM_INF), 0) << width;
    if (width > 8) {
      EXPECT_GT(cv::countNonZero(vector.Seen()), 100);
    }
    for (auto& z : sheet.corners.inverse_z) z *= 1.3f;
    for (int y = 0; y < sheet.height; ++y) {
      EraseBehindCellsScalar(sheet.Run(0, y, width), scalar.Target());
      EraseBehindCells(sheet.Run(0, y, width), vector.Target());
    }
    EXPECT_EQ(cv::norm(scalar.Seen(), vector.Seen(), cv::NORM_INF), 0) << width;
  }
}

TEST(ProjectCorners, VectorCodeGivesTheScalarBitsForEveryRemainder) {
  std::mt19937 random(2);
  const PinholeCamera camera{.width = 640,
                             .height = 480,
                             .fx = 600,
                             .fy = 590,
                             .cx = 320,
                             .cy = 240,
                             .k1 = -0.2,
                             .p1 = 0.001,
                             .k4 = 0.05};
  const auto lens = raster::RasterLens::Of(camera, 0.1);
  const float t[3] = {0.07f, -0.02f, 0.01f};
  std::uniform_real_distribution<float> side(-0.6f, 0.6f), depth(-1.0f, 6.0f);
  for (std::size_t count = 0; count < 68; ++count) {
    CornerRays rays;
    rays.Resize(count);
    std::vector<float> z(count + 8, 0.0f);
    for (std::size_t i = 0; i < count; ++i) {
      rays.x[i] = side(random), rays.y[i] = side(random), rays.z[i] = 1;
      z[i] = std::max(0.0f, depth(random));
    }
    GridCorners scalar, vector;
    scalar.Resize(count);
    vector.Resize(count);
    ProjectCornersScalar(lens, t, rays, z.data(), 0, count, scalar);
    ProjectCorners(lens, t, rays, z.data(), 0, count, vector);
    for (std::size_t i = 0; i < count; ++i) {
      EXPECT_EQ(scalar.x[i], vector.x[i]);
      EXPECT_EQ(scalar.y[i], vector.y[i]);
      EXPECT_EQ(scalar.inverse_z[i], vector.inverse_z[i]);
      EXPECT_EQ(scalar.outcode[i], vector.outcode[i]);
    }
  }
}

TEST(ScanCells, EveryPixelOfTheSheetIsCoveredExactlyOnce) {
  std::mt19937 random(3);
  // Not so far that a triangle turns over: those are seen from behind and left out.
  for (const int jitter : {0, kSubPixels, 6 * kSubPixels / 5}) {
    const Sheet sheet(14, 12, jitter, random);
    cv::Mat1i covered(40, 50, 0);
    for (int y = 0; y < sheet.height; ++y) {
      for (int x = 0; x < sheet.width; ++x) {
        Picture picture(50, 40);
        ScanCells(sheet.Run(x, y, 1), picture.Target());
        for (int v = 0; v < 40; ++v) {
          for (int u = 0; u < 50; ++u) covered(v, u) += picture.inverse_z(v, u) > 0;
        }
      }
    }
    double fewest = 0, most = 0;
    cv::minMaxLoc(covered, &fewest, &most);
    EXPECT_EQ(fewest, 1) << jitter;
    EXPECT_EQ(most, 1) << jitter;
  }
}

TEST(ScanCells, PartsAreTheTrianglesTheyName) {
  std::mt19937 random(4);
  Sheet sheet(1, 1, 0, random);
  for (auto& x : sheet.corners.x) x = 0;
  // One cell from (0, 0) to (8, 8), corners between pixels.
  const int low = -kSubPixels / 2, high = 15 * kSubPixels / 2;
  const int stride = sheet.stride;
  auto place = [&](int i, int x, int y) {
    sheet.corners.x[static_cast<std::size_t>(i)] = x;
    sheet.corners.y[static_cast<std::size_t>(i)] = y;
  };
  place(0, low, low), place(1, high, low), place(stride, low, high), place(stride + 1, high, high);
  auto covers = [&](int parts, int u, int v) {
    sheet.cells[0] = static_cast<std::uint8_t>(parts);
    Picture picture(8, 8);
    ScanCells(sheet.Run(0, 0, 1), picture.Target());
    return picture.inverse_z(v, u) > 0;
  };
  const std::pair<int, int> top_left{1, 1}, top_right{6, 1}, bottom_left{1, 6}, bottom_right{6, 6};
  auto expect = [&](int parts, bool tl, bool tr, bool bl, bool br) {
    EXPECT_EQ(covers(parts, top_left.first, top_left.second), tl) << parts;
    EXPECT_EQ(covers(parts, top_right.first, top_right.second - 1), tr) << parts;
    EXPECT_EQ(covers(parts, bottom_left.first, bottom_left.second), bl) << parts;
    EXPECT_EQ(covers(parts, bottom_right.first, bottom_right.second), br) << parts;
  };
  expect(kWhole, true, true, true, true);
  expect(kWhole | kTurned, true, true, true, true);
  EXPECT_TRUE(covers(kUpper, 1, 1) && !covers(kUpper, 6, 6));
  EXPECT_TRUE(covers(kLower, 6, 6) && !covers(kLower, 1, 1));
  EXPECT_TRUE(covers(kUpper | kTurned, 6, 1) && !covers(kUpper | kTurned, 1, 6));
  EXPECT_TRUE(covers(kLower | kTurned, 1, 6) && !covers(kLower | kTurned, 6, 1));
  EXPECT_FALSE(covers(kTorn, 3, 3));
}

TEST(ScanCells, PartsSeenFromBehindAreNone) {
  std::mt19937 random(4);
  Sheet sheet(1, 1, 0, random);
  // The cell mirrored: its right corners lie left.
  for (auto& x : sheet.corners.x) x = 5 * kSubPixels - x;
  for (const int parts : {int{kUpper}, int{kLower}, kUpper | kTurned, kLower | kTurned, int{kWhole}}) {
    sheet.cells[0] = static_cast<std::uint8_t>(parts);
    Picture vector(12, 12), scalar(12, 12);
    ScanCells(sheet.Run(0, 0, 1), vector.Target());
    ScanCellsScalar(sheet.Run(0, 0, 1), scalar.Target());
    EXPECT_EQ(cv::countNonZero(vector.inverse_z) + cv::countNonZero(scalar.inverse_z), 0) << parts;
  }
}

TEST(ScanCells, AUselessCornerDoesNotHurtTheOtherPart) {
  std::mt19937 random(5);
  Sheet sheet(3, 3, 0, random);
  const auto bottom_right = static_cast<std::size_t>(2 * sheet.stride + 2);
  sheet.corners.outcode[bottom_right] = raster::kNear;
  sheet.corners.x[bottom_right] = -1'000'000;
  const auto cell = static_cast<std::size_t>(sheet.stride + 1);
  Picture picture(10, 10);
  sheet.cells[cell] = kUpper;
  ScanCells(sheet.Run(1, 1, 1), picture.Target());
  EXPECT_GT(cv::countNonZero(picture.inverse_z), 5);
  Picture other(10, 10);
  sheet.cells[cell] = kWhole;
  ScanCells(sheet.Run(1, 1, 1), other.Target());
  EXPECT_EQ(cv::countNonZero(other.inverse_z), 0);
}

TEST(TakeDepth, GivesDepthAndLeavesNothing) {
  for (std::size_t n = 0; n < 40; ++n) {
    std::vector<float> inverse(n), depth(n, -1.0f);
    for (std::size_t i = 0; i < n; ++i) inverse[i] = i % 3 == 0 ? 0.0f : 0.25f * static_cast<float>(i);
    const std::vector<float> before = inverse;
    TakeDepth(inverse.data(), depth.data(), n);
    for (std::size_t i = 0; i < n; ++i) {
      EXPECT_EQ(depth[i], i % 3 == 0 ? 0.0f : 1.0f / before[i]);
      EXPECT_EQ(inverse[i], 0);
    }
  }
}

}  // namespace
}  // namespace mixstage::depth
