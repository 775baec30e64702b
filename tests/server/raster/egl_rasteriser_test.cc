// SPDX-License-Identifier: Apache-2.0
//
// The two back ends held against each other: the same triangles, the same picture.
#include "server/raster/egl_rasteriser.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "server/raster/rasteriser.h"
#include "tests/support/egl_or_skip.h"

namespace mixstage {
namespace {

PinholeCamera StrongLens() {
  return {.width = 256,
          .height = 192,
          .fx = 248,
          .fy = 246,
          .cx = 129.0,
          .cy = 94.4,
          .k1 = -0.25,
          .k2 = 0.08,
          .p1 = 0.0008,
          .p2 = -0.0005};
}
PinholeCamera StraightLens() {
  return {.width = 256, .height = 192, .fx = 250, .fy = 250, .cx = 127.5, .cy = 95.5};
}

struct Mesh {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::uint32_t> indices;
  [[nodiscard]] TriangleMeshView View() const { return {positions, indices}; }
};

// Triangles of every size from a tenth of a pixel to the whole view, some behind the camera.
Mesh Soup(std::uint32_t seed, int triangles) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> side(-1, 1), log_size(-7, 0.7f), distance(-0.5f, 6);
  Mesh mesh;
  for (int t = 0; t < triangles; ++t) {
    const Eigen::Vector3f center(2 * side(random), 1.5f * side(random), distance(random));
    const float size = std::exp(log_size(random));
    for (int k = 0; k < 3; ++k) {
      mesh.indices.push_back(static_cast<std::uint32_t>(mesh.positions.size()));
      mesh.positions.push_back(center + size * Eigen::Vector3f(side(random), side(random), side(random)));
    }
  }
  return mesh;
}

struct Difference {
  int covered = 0;      // pixels that both cover
  int outline = 0;      // pixels that one covers and the other does not
  int other_id = 0;     // of the covered
  double worst_depth = 0;  // relative, where both show the same triangle
  cv::Rect touched[2];
};

template <typename DrawAll>
Difference Compare(const PinholeCamera& camera, const PictureGrid& grid, double near_m, DrawAll draw) {
  auto cpu = *CreateRasteriser(RasterBackend::kCpu, camera, {.near_m = near_m});
  auto egl = *CreateRasteriser(RasterBackend::kEgl, camera, {.near_m = near_m}, test::SharedGpu());
  for (Rasteriser* rasteriser : {cpu.get(), egl.get()}) {
    rasteriser->Begin(grid);
    draw(*rasteriser);
  }
  const VisibilityBuffer& a = cpu->Finish();
  const VisibilityBuffer& b = egl->Finish();
  Difference d;
  d.touched[0] = a.touched, d.touched[1] = b.touched;
  EXPECT_EQ(a.depth_m.size(), b.depth_m.size());
  for (int y = 0; y < a.depth_m.rows; ++y) {
    for (int x = 0; x < a.depth_m.cols; ++x) {
      const bool in_a = a.depth_m(y, x) > 0;
      const bool in_b = b.depth_m(y, x) > 0;
      d.outline += in_a != in_b;
      if (!in_a || !in_b) continue;
      ++d.covered;
      if (a.triangle(y, x) != b.triangle(y, x)) {
        ++d.other_id;
      } else {
        d.worst_depth = std::max(d.worst_depth, std::abs(double{b.depth_m(y, x)} / a.depth_m(y, x) - 1));
      }
    }
  }
  return d;
}

class EglRasteriserTest : public testing::Test {
 protected:
  void SetUp() override { MIXSTAGE_SKIP_WITHOUT_EGL(); }
};

const Eigen::Affine3d kHere = Eigen::Affine3d::Identity();

TEST_F(EglRasteriserTest, SoupsOfTrianglesLookTheSameOnBoth) {
  for (const PinholeCamera& camera : {StrongLens(), StraightLens()}) {
    for (std::uint32_t seed = 1; seed <= 4; ++seed) {
      const Mesh soup = Soup(seed, 400);
      for (const Faces faces : {Faces::kBoth, Faces::kFrontOnly}) {
        const Difference d = Compare(camera, {}, 0.05, [&](Rasteriser& r) { r.Draw(soup.View(), kHere, 7, faces); });
        std::printf("soup %u faces %d: covered %d outline %d other id %d depth %g\n", seed, static_cast<int>(faces), d.covered, d.outline, d.other_id, d.worst_depth);
        EXPECT_GT(d.covered, 5000);
        EXPECT_EQ(d.touched[0], d.touched[1]);
      }
    }
  }
}

}  // namespace
}  // namespace mixstage
