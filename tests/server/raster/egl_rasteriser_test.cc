// SPDX-License-Identifier: Apache-2.0
//
// The two back ends held against each other: the same triangles, the same picture.
//
// Tolerances. Corners are equal to the bit and GL_SUBPIXEL_BITS is 8 or more, so coverage may differ only
// where an edge runs through a pixel's centre (GL leaves open to whom it belongs) or where two surfaces are
// nearer to each other than 1/z is rounded. 1/z is interpolated in single precision by both, in another
// order: equal within 1e-4, but in slivers of less than 1/64 px, which the cpu back end holds flat. All of
// these together: 0.1 % of the pixels.
#include "server/raster/egl_rasteriser.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <limits>
#include <random>
#include <thread>
#include <vector>

#include "server/raster/rasteriser.h"
#include "server/raster/render_device.h"
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
PinholeCamera FoldingLens() {
  return {.width = 200, .height = 200, .fx = 165, .fy = 165, .cx = 99.5, .cy = 99.5, .k1 = -0.5};
}

struct Mesh {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::uint32_t> indices;
  [[nodiscard]] TriangleMeshView View() const { return {positions, indices}; }
};

// Triangles of every size from a tenth of a pixel to the whole view; some behind the camera, some across the
// near plane, some that are none.
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
    if (t % 50 == 0) mesh.positions.back().x() = std::numeric_limits<float>::quiet_NaN();
    if (t % 50 == 1) mesh.positions.back() = mesh.positions[mesh.positions.size() - 2];
  }
  return mesh;
}

// A floor under the camera, a wall, both of two triangles, and a bumpy sheet of 60 x 60 small ones.
Mesh Room() {
  Mesh mesh;
  mesh.positions = {{-50, 0.6f, -20}, {50, 0.6f, -20}, {50, 0.6f, 30}, {-50, 0.6f, 30},
                    {-9, -7, 4},      {9, -7, 5},      {9, 7, 4},      {-9, 7, 3}};
  mesh.indices = {0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7};
  const std::uint32_t first = 8, n = 60;
  for (std::uint32_t j = 0; j <= n; ++j) {
    for (std::uint32_t i = 0; i <= n; ++i) {
      const float x = static_cast<float>(i) / n - 0.5f, y = static_cast<float>(j) / n - 0.5f;
      mesh.positions.emplace_back(x, y, 1.2f + 0.05f * std::sin(20 * x) * std::cos(17 * y));
    }
  }
  for (std::uint32_t j = 0; j < n; ++j) {
    for (std::uint32_t i = 0; i < n; ++i) {
      const std::uint32_t a = first + j * (n + 1) + i, c = a + n + 1;
      for (const std::uint32_t k : {a, c, a + 1, a + 1, c, c + 1}) mesh.indices.push_back(k);
    }
  }
  return mesh;
}

std::unique_ptr<Rasteriser> Make(RasterBackend backend, const PinholeCamera& camera, double near_m = 0.05) {
  auto made = CreateRasteriser(backend, camera, {.near_m = near_m}, test::SharedGpu());
  EXPECT_TRUE(made) << made.error().message;
  return std::move(*made);
}

void ExpectSame(const VisibilityBuffer& cpu, const VisibilityBuffer& egl, int least_covered) {
  ASSERT_EQ(cpu.depth_m.size(), egl.depth_m.size());
  EXPECT_EQ(cpu.touched, egl.touched);
  int covered = 0, differing = 0;
  for (int y = 0; y < cpu.depth_m.rows; ++y) {
    for (int x = 0; x < cpu.depth_m.cols; ++x) {
      const float a = cpu.depth_m(y, x), b = egl.depth_m(y, x);
      covered += a > 0;
      if ((a > 0) != (b > 0) || cpu.triangle(y, x) != egl.triangle(y, x)) {
        ++differing;
      } else if (a > 0 && std::abs(b / a - 1) > 1e-4f) {
        ++differing;
      }
    }
  }
  EXPECT_GE(covered, least_covered);
  EXPECT_LE(differing, 1 + covered / 1000);
}

const Eigen::Affine3d kHere = Eigen::Affine3d::Identity();

class EglRasteriserTest : public testing::Test {
 protected:
  void SetUp() override { MIXSTAGE_SKIP_WITHOUT_EGL(); }

  template <typename DrawAll>
  static void Compare(const PinholeCamera& camera, const PictureGrid& grid, int least_covered, DrawAll draw,
                      double near_m = 0.05) {
    auto cpu = Make(RasterBackend::kCpu, camera, near_m);
    auto egl = Make(RasterBackend::kEgl, camera, near_m);
    for (Rasteriser* rasteriser : {cpu.get(), egl.get()}) {
      rasteriser->Begin(grid);
      draw(*rasteriser);
    }
    ExpectSame(cpu->Finish(), egl->Finish(), least_covered);
  }
};

TEST_F(EglRasteriserTest, SoupsOfTrianglesLookTheSameThroughAnyLens) {
  for (const PinholeCamera& camera : {StrongLens(), StraightLens(), FoldingLens()}) {
    for (std::uint32_t seed = 1; seed <= 3; ++seed) {
      const Mesh soup = Soup(seed, 400);
      for (const Faces faces : {Faces::kBoth, Faces::kFrontOnly}) {
        Compare(camera, {}, 5000, [&](Rasteriser& r) { r.Draw(soup.View(), kHere, 7, faces); });
      }
    }
  }
}

TEST_F(EglRasteriserTest, FinerGridsAndRegionsLookTheSame) {
  const Mesh room = Room();
  for (const int scale : {1, 2, 4}) {
    Compare(StrongLens(), {.scale = scale, .region_px = {31, 40, 100, 90}}, 9000 * scale * scale,
            [&](Rasteriser& r) { r.Draw(room.View(), kHere, 0, Faces::kBoth); });
  }
}

TEST_F(EglRasteriserTest, FloorsThroughTheNearPlaneLookTheSame) {
  const Mesh room = Room();
  for (const double near_m : {0.01, 0.05, 0.5, 2.0}) {
    Compare(
        StrongLens(), {}, 10'000, [&](Rasteriser& r) { r.Draw(room.View(), kHere, 3, Faces::kBoth); },
        near_m);
  }
}

TEST_F(EglRasteriserTest, MirroredTurnedAndScaledObjectsLookTheSame) {
  const Mesh soup = Soup(9, 200);
  const Mesh room = Room();
  Eigen::Affine3d mirrored = Eigen::Affine3d(Eigen::Translation3d(0, 0, 0.4)) *
                             Eigen::AngleAxisd(0.3, Eigen::Vector3d(1, 2, 3).normalized()) *
                             Eigen::Scaling(-1.3, 0.9, 1.1);
  Compare(StrongLens(), {}, 10'000, [&](Rasteriser& r) {
    r.Draw(soup.View(), mirrored, 0, Faces::kFrontOnly);
    r.Draw(room.View(), mirrored, 1000, Faces::kFrontOnly);
    r.Draw(soup.View(), kHere, 100'000, Faces::kBoth);
  });
}

TEST_F(EglRasteriserTest, OfEqualDepthsTheFirstDrawnStays) {
  const Mesh room = Room();
  auto egl = Make(RasterBackend::kEgl, StrongLens());
  egl->Begin({});
  egl->Draw(room.View(), kHere, 0, Faces::kBoth);
  egl->Draw(room.View(), kHere, 1'000'000, Faces::kBoth);
  double largest = 0;
  cv::minMaxLoc(egl->Finish().triangle, nullptr, &largest);
  EXPECT_LT(largest, 1'000'000);
}

TEST_F(EglRasteriserTest, DepthAloneIsThatOfACpuShadowMap) {
  const Mesh soup = Soup(4, 300);
  const Mesh room = Room();
  // Depth alone first, then ids over it, then depth alone again: ids stay where they were written.
  Compare(StraightLens(), {}, 10'000, [&](Rasteriser& r) {
    r.DrawDepth(soup.View(), kHere, Faces::kBoth);
    r.Draw(room.View(), kHere, 5, Faces::kBoth);
  });
  Compare(StraightLens(), {}, 10'000,
          [&](Rasteriser& r) { r.DrawDepth(room.View(), kHere, Faces::kFrontOnly); });
}

TEST_F(EglRasteriserTest, ALostContextCostsNoPictureAndComesBack) {
  auto gpu = *gl::Gpu::Create();
  auto cpu = Make(RasterBackend::kCpu, StrongLens());
  auto egl = *CreateRasteriser(RasterBackend::kEgl, StrongLens(), {}, gpu);
  const Mesh room = Room();
  const std::uint64_t generation = gpu->generation();
  auto draw = [&](Rasteriser& r) {
    r.Begin({});
    r.Draw(room.View(), kHere, 0, Faces::kBoth);
  };
  draw(*cpu);
  const VisibilityBuffer& truth = cpu->Finish();
  // Between two pictures, and while one is being drawn.
  for (const bool while_drawing : {false, true}) {
    if (!while_drawing) gpu->LoseForTest();
    draw(*egl);
    if (while_drawing) gpu->LoseForTest();
    ExpectSame(truth, egl->Finish(), 10'000);
  }
  // Two losses at once are not both repaired at once (a driver that is still resetting is asked ten times a
  // second): meanwhile the picture comes from here.
  bool is_back = false;
  for (int i = 0; i < 200 && !is_back; ++i) {
    draw(*egl);
    ExpectSame(truth, egl->Finish(), 10'000);
    const auto current = gpu->Enter();
    is_back = current && current->Check("after");
    if (!is_back) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_TRUE(is_back);
  EXPECT_GE(gpu->generation(), generation + 2);
}

TEST_F(EglRasteriserTest, MayChangeItsThreadBetweenPictures) {
  auto cpu = Make(RasterBackend::kCpu, StrongLens());
  auto egl = Make(RasterBackend::kEgl, StrongLens());
  const Mesh room = Room();
  cpu->Begin({});
  cpu->Draw(room.View(), kHere, 0, Faces::kBoth);
  const VisibilityBuffer& truth = cpu->Finish();
  for (int i = 0; i < 3; ++i) {
    std::thread([&] {
      egl->Begin({});
      egl->Draw(room.View(), kHere, 0, Faces::kBoth);
      ExpectSame(truth, egl->Finish(), 10'000);
    }).join();
  }
}

TEST(ChooseBackend, TakesSoftwareGlOnlyWhenToldTo) {
  EXPECT_EQ(ChooseBackend(RendererChoice::kCpu)->Name(), "cpu");
  const auto automatic = ChooseBackend(RendererChoice::kAuto);
  ASSERT_TRUE(automatic);
  const auto gpu = test::SharedGpu();
  const bool real = gpu && !gpu->info().software;
  EXPECT_EQ(automatic->backend, real ? RasterBackend::kEgl : RasterBackend::kCpu);
  const auto told = ChooseBackend(RendererChoice::kEgl);
  ASSERT_EQ(told.has_value(), gpu != nullptr);
  if (told) {
    EXPECT_EQ(told->Name().substr(0, 5), "egl (");
  }
}

TEST(ParseRenderer, KnowsItsNames) {
  for (const char* name : {"auto", "cpu", "egl"}) EXPECT_STREQ(RendererName(*ParseRenderer(name)), name);
  EXPECT_NE(ParseRenderer("vulkan").error().message.find("auto, cpu, egl"), std::string::npos);
}

}  // namespace
}  // namespace mixstage
