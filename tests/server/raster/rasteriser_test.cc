// SPDX-License-Identifier: Apache-2.0
#include "server/raster/rasteriser.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "server/raster/triangle_plane.h"
#include "tests/support/egl_or_skip.h"

namespace mixstage {
namespace {

// 50 degrees across with the strong barrel of a cheap wide lens.
PinholeCamera StrongLens() {
  return {.width = 640,
          .height = 480,
          .fx = 620,
          .fy = 615,
          .cx = 322.5,
          .cy = 236.0,
          .k1 = -0.25,
          .k2 = 0.08,
          .p1 = 0.0008,
          .p2 = -0.0005};
}

struct Mesh {
  std::vector<Eigen::Vector3f> positions;
  std::vector<std::uint32_t> indices;
  [[nodiscard]] TriangleMeshView View() const { return {positions, indices}; }
  [[nodiscard]] TriangleMeshView One(std::size_t t) const {
    return {positions, std::span(indices).subspan(3 * t, 3)};
  }
  [[nodiscard]] std::size_t triangles() const { return indices.size() / 3; }
};

// The quad with corner `origin` and sides u, v, as cells x cells pairs of triangles.
Mesh Quad(const Eigen::Vector3f& origin, const Eigen::Vector3f& u, const Eigen::Vector3f& v, int cells = 1) {
  Mesh mesh;
  for (int j = 0; j <= cells; ++j) {
    for (int i = 0; i <= cells; ++i) {
      mesh.positions.push_back(origin + u * (static_cast<float>(i) / static_cast<float>(cells)) +
                               v * (static_cast<float>(j) / static_cast<float>(cells)));
    }
  }
  for (int j = 0; j < cells; ++j) {
    for (int i = 0; i < cells; ++i) {
      const auto a = static_cast<std::uint32_t>(j * (cells + 1) + i);
      const std::uint32_t c = a + static_cast<std::uint32_t>(cells) + 1;
      for (const std::uint32_t index : {a, a + 1, c, a + 1, c + 1, c}) mesh.indices.push_back(index);
    }
  }
  return mesh;
}

const Eigen::Affine3d kHere = Eigen::Affine3d::Identity();

cv::Mat1f DepthOf(Rasteriser& rasteriser, const Mesh& mesh, Faces faces = Faces::kBoth) {
  rasteriser.Begin({});
  rasteriser.Draw(mesh.View(), kHere, 0, faces);
  return rasteriser.Finish().depth_m.clone();
}

// What holds for a back end holds for each.
class RasteriserTest : public testing::TestWithParam<RasterBackend> {
 protected:
  void SetUp() override {
    if (GetParam() == RasterBackend::kEgl) MIXSTAGE_SKIP_WITHOUT_EGL();
  }
  static std::unique_ptr<Rasteriser> Make(const PinholeCamera& camera, double near_m = 0.05) {
    auto made = CreateRasteriser(GetParam(), camera, {.near_m = near_m}, test::SharedGpu());
    EXPECT_TRUE(made) << made.error().message;
    return std::move(*made);
  }
};
INSTANTIATE_TEST_SUITE_P(BackEnds, RasteriserTest, testing::Values(RasterBackend::kCpu, RasterBackend::kEgl),
                         [](const auto& each) { return each.param == RasterBackend::kCpu ? "cpu" : "egl"; });

TEST_P(RasteriserTest, PlaneOfTwoTrianglesHasTheRaysDepthThroughAStrongLens) {
  const PinholeCamera camera = StrongLens();
  const cv::Mat2f rays = UnprojectionTable(camera);
  auto rasteriser = Make(camera);
  // A slanted wall far larger than the view.
  const Eigen::Vector3f origin(-8, -7, 2.5f), u(16, 0, 3), v(0, 14, 1);
  const cv::Mat1f depth = DepthOf(*rasteriser, Quad(origin, u, v));
  const Eigen::Vector3f n = u.cross(v);
  double worst = 0;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Eigen::Vector3f ray(rays(y, x)[0], rays(y, x)[1], 1);
      const float truth = n.dot(origin) / n.dot(ray);
      ASSERT_GT(depth(y, x), 0) << x << "," << y;
      worst = std::max(worst, double{std::abs(depth(y, x) / truth - 1)});
    }
  }
  EXPECT_LT(worst, 1e-4);
}

TEST_P(RasteriserTest, OutlineFollowsTheLensesCurveToATenthOfAPixel) {
  const PinholeCamera camera = StrongLens();
  auto rasteriser = Make(camera);
  // Its upper edge runs straight across the room and bent across the picture.
  const cv::Mat1f depth = DepthOf(*rasteriser, Quad({-4, -0.9f, 3}, {8, 0.1f, 0}, {0, 1.2f, 0}));
  for (int x = 20; x < camera.width - 20; ++x) {
    int first = 0;
    while (first < camera.height && depth(first, x) == 0) ++first;
    ASSERT_LT(first, camera.height);
    // The edge crosses column x between rows first - 1 and first.
    const auto below = camera.Unproject({x, first + 0.1});
    const auto above = camera.Unproject({x, first - 1.1});
    auto over_edge = [](const Eigen::Vector2d& ray) {
      return 3 * ray.y() - (-0.9 + 0.1 * (3 * ray.x() + 4) / 8);
    };
    EXPECT_GE(over_edge(*below), 0) << x;
    EXPECT_LE(over_edge(*above), 0) << x;
  }
}

TEST_P(RasteriserTest, SplitTrianglesLeaveNoGapAndNoDoublePixel) {
  const PinholeCamera camera = StrongLens();
  auto rasteriser = Make(camera);
  // Cells from two pixels to the whole view beside each other, all corners shared; across the near plane too.
  std::mt19937 random(5);
  Mesh mesh;
  std::vector<float> lines = {-30, -6, -1.5f, -0.4f, -0.38f, -0.1f, 0.2f, 0.9f, 5, 40};
  for (const float y : lines) {
    for (const float x : lines) {
      std::uniform_real_distribution<float> jitter(-0.004f, 0.004f);
      // The sheet comes towards the camera on the left and passes behind its plane there.
      mesh.positions.emplace_back(x + jitter(random), y + jitter(random), 2.0f + 0.31f * x);
    }
  }
  const auto n = static_cast<std::uint32_t>(lines.size());
  for (std::uint32_t j = 0; j + 1 < n; ++j) {
    for (std::uint32_t i = 0; i + 1 < n; ++i) {
      const std::uint32_t a = j * n + i;
      for (const std::uint32_t k : {a, a + 1, a + n, a + n + 1, a + 1, a + n}) mesh.indices.push_back(k);
    }
  }
  cv::Mat1i covered(camera.height, camera.width, 0);
  for (std::size_t t = 0; t < mesh.triangles(); ++t) {
    rasteriser->Begin({});
    rasteriser->Draw(mesh.One(t), kHere, 7, Faces::kBoth);
    const VisibilityBuffer& seen = rasteriser->Finish();
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const bool hit = seen.triangle(y, x) == 7;
        EXPECT_EQ(hit, seen.depth_m(y, x) > 0);
        covered(y, x) += hit;
      }
    }
  }
  double fewest = 0, most = 0;
  cv::minMaxLoc(covered, &fewest, &most);
  EXPECT_EQ(fewest, 1);
  EXPECT_EQ(most, 1);
}

TEST_P(RasteriserTest, NearPlaneCutsAFloorThatRunsUnderTheCamera) {
  const PinholeCamera camera{
      .width = 320, .height = 240, .fx = 150, .fy = 150, .cx = 159.5, .cy = 119.5, .k1 = -0.05};
  const cv::Mat2f rays = UnprojectionTable(camera);
  auto rasteriser = Make(camera, /*near_m=*/0.5);
  const float height = 0.3f;
  const cv::Mat1f depth = DepthOf(*rasteriser, Quad({-50, height, -20}, {100, 0, 0}, {0, 0, 60}));
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const float slope = rays(y, x)[1];
      const float truth = slope > 0 ? height / slope : 0;
      if (truth > 0.52f && truth < 39) {
        // An edge's chord may leave its curve by 0.05 px, which is far on the floor near the horizon.
        EXPECT_NEAR(depth(y, x) / truth, 1, 1e-4 + 0.05 / camera.fy / slope) << x << "," << y;
      } else if (truth < 0.48f || truth > 41) {
        EXPECT_EQ(depth(y, x), 0) << x << "," << y;
      }
    }
  }
}

TEST_P(RasteriserTest, TheHalfSpaceCutsATriangleOnItsPlane) {
  const PinholeCamera camera = StrongLens();
  auto rasteriser = Make(camera);
  // A wall 3 m away; drawn where x + y / 2 >= 0.1, through the near plane too.
  const Eigen::Vector3f normal = Eigen::Vector3f(2, 1, 0).normalized();
  PictureGrid grid;
  grid.half_space << normal, -0.2f / std::sqrt(5.0f);
  const auto draw = [&](const Mesh& mesh) {
    rasteriser->Begin(grid);
    rasteriser->Draw(mesh.View(), kHere, 0, Faces::kBoth);
    return rasteriser->Finish().depth_m.clone();
  };
  const cv::Mat1f cut = draw(Quad({-4, -4, 3}, {8, 0, 0}, {0, 8, 0}, 3));
  int kept = 0;
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      const auto ray = camera.Unproject({u, v});
      ASSERT_TRUE(ray);
      const double over = 3 * (2 * ray->x() + ray->y()) - 0.2;
      if (std::abs(over) < 0.02) continue;  // a pixel
      ASSERT_EQ(cut(v, u) > 0, over > 0) << u << " " << v;
      if (over < 0) continue;
      ASSERT_NEAR(cut(v, u), 3, 1e-4);
      ++kept;
    }
  }
  EXPECT_GT(kept, 20000);
  const cv::Mat1f floor = draw(Quad({-1, 0.5f, -1}, {2, 0, 0}, {0, 0, 9}));
  EXPECT_GT(cv::countNonZero(floor), 1000);
  for (int u = 0; u < camera.width / 3; ++u) ASSERT_EQ(floor(camera.height - 1, u), 0);
}

TEST_P(RasteriserTest, NothingFoldsBackIntoThePicture) {
  // Folds at r = 0.816 (39 degrees), where it images at r = 0.544; the picture's corners lie beyond.
  const PinholeCamera camera{
      .width = 400, .height = 400, .fx = 330, .fy = 330, .cx = 199.5, .cy = 199.5, .k1 = -0.5};
  auto rasteriser = Make(camera);
  // Only beyond the fold: x/z from 1.0 to 1.2, which the polynomial would put at 0.5 and less.
  EXPECT_EQ(cv::countNonZero(DepthOf(*rasteriser, Quad({2, -1, 2}, {0.4f, 0, 0}, {0, 2, 0}, 20))), 0);
  // A wall across everything: every pixel that has a ray well inside the fold has its depth, the others
  // nothing wrong.
  const cv::Mat1f depth = DepthOf(*rasteriser, Quad({-9, -9, 2}, {18, 0, 0}, {0, 18, 0}));
  const cv::Mat2f rays = UnprojectionTable(camera);
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const double r = std::hypot(rays(y, x)[0], rays(y, x)[1]);
      if (r < 0.77) {
        EXPECT_NEAR(depth(y, x), 2, 1e-3) << x << "," << y;
      } else if (depth(y, x) > 0) {
        EXPECT_NEAR(depth(y, x), 2, 1e-3) << x << "," << y;
      }
    }
  }
}

TEST_P(RasteriserTest, HugeDegenerateAndNotFiniteTrianglesAreHarmless) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  auto rasteriser = Make(StrongLens());
  Mesh mesh;
  mesh.positions = {{0, 0, 2},     {0.1f, 0, 2}, {0.2f, 0, 2},     {kNan, 0, 2},      {kInf, 0, 2},
                    {0, -kInf, 2}, {9e5f, 0, 2}, {-9e5f, 9e5f, 2}, {0, -9e5f, 0.06f}, {1e20f, 0, 1},
                    {0, 0, 0},     {0, 0, -1},   {1e-30f, 0, 1}};
  for (std::uint32_t a = 0; a < mesh.positions.size(); ++a) {
    for (std::uint32_t b = 0; b < mesh.positions.size(); ++b) {
      for (std::uint32_t c = 0; c < mesh.positions.size(); ++c) {
        if (a >= 3 && a != 6 && a != 10) continue;
        for (const std::uint32_t k : {a, b, c}) mesh.indices.push_back(k);
      }
    }
  }
  rasteriser->Begin({});
  rasteriser->Draw(mesh.View(), kHere, 0, Faces::kBoth);
  const VisibilityBuffer& seen = rasteriser->Finish();
  for (int y = 0; y < seen.depth_m.rows; ++y) {
    for (int x = 0; x < seen.depth_m.cols; ++x) {
      ASSERT_TRUE(std::isfinite(seen.depth_m(y, x)));
      if (seen.triangle(y, x) < 0) continue;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto index = mesh.indices[3 * static_cast<std::size_t>(seen.triangle(y, x)) + k];
        EXPECT_TRUE(mesh.positions[index].allFinite() && mesh.positions[index].x() < 1e10f);
      }
    }
  }
}

TEST_P(RasteriserTest, NearerWinsInAnyOrderAndIdsKeepTheirOffsets) {
  auto rasteriser = Make(StrongLens());
  const Mesh near_quad = Quad({-0.2f, -0.2f, 1}, {0.4f, 0, 0}, {0, 0.4f, 0}, 5);
  const Mesh wall = Quad({-4, -4, 3}, {8, 0, 0}, {0, 8, 0}, 3);
  cv::Mat1i first;
  for (const bool near_first : {true, false}) {
    rasteriser->Begin({});
    if (near_first) rasteriser->Draw(near_quad.View(), kHere, 1000, Faces::kBoth);
    rasteriser->Draw(wall.View(), kHere, 10, Faces::kBoth);
    if (!near_first) rasteriser->Draw(near_quad.View(), kHere, 1000, Faces::kBoth);
    const VisibilityBuffer& seen = rasteriser->Finish();
    EXPECT_NEAR(seen.depth_m(236, 322), 1, 1e-4);
    EXPECT_GE(seen.triangle(236, 322), 1000);
    EXPECT_LT(seen.triangle(236, 322), 1050);
    EXPECT_NEAR(seen.depth_m(20, 20), 3, 1e-3);
    EXPECT_GE(seen.triangle(20, 20), 10);
    EXPECT_LT(seen.triangle(20, 20), 28);
    if (near_first)
      first = seen.triangle.clone();
    else
      EXPECT_EQ(cv::norm(first, seen.triangle, cv::NORM_INF), 0);
  }
}

TEST_P(RasteriserTest, BeginForgetsAndTouchedBoundsWhatIsThere) {
  auto rasteriser = Make(StrongLens());
  rasteriser->Begin({});
  rasteriser->Draw(Quad({-0.2f, -0.3f, 1}, {0.4f, 0, 0}, {0, 0.5f, 0}).View(), kHere, 3, Faces::kBoth);
  const VisibilityBuffer& seen = rasteriser->Finish();
  const int all = cv::countNonZero(seen.depth_m);
  EXPECT_GT(all, 1000);
  EXPECT_EQ(cv::countNonZero(seen.depth_m(seen.touched)), all);
  EXPECT_LT(seen.touched.area(), 2 * all);
  rasteriser->Begin({.scale = 2, .region_px = {300, 200, 60, 60}});
  rasteriser->Begin({});
  const VisibilityBuffer& empty = rasteriser->Finish();
  EXPECT_TRUE(empty.touched.empty());
  EXPECT_EQ(cv::countNonZero(empty.depth_m), 0);
  EXPECT_EQ(cv::countNonZero(empty.triangle != -1), 0);
}

TEST_P(RasteriserTest, FrontFacesAreCounterClockwiseAlsoUnderAMirror) {
  auto rasteriser = Make(StrongLens());
  // Right-handed with y down and z forward: towards the camera means the normal points to -z.
  const Mesh towards = Quad({-1, -1, 2}, {0, 2, 0}, {2, 0, 0});
  EXPECT_GT(cv::countNonZero(DepthOf(*rasteriser, towards, Faces::kFrontOnly)), 0);
  const Mesh away = Quad({-1, -1, 2}, {2, 0, 0}, {0, 2, 0});
  EXPECT_EQ(cv::countNonZero(DepthOf(*rasteriser, away, Faces::kFrontOnly)), 0);
  EXPECT_GT(cv::countNonZero(DepthOf(*rasteriser, away, Faces::kBoth)), 0);
  // The mirrored model's outside stays its outside.
  Eigen::Affine3d mirror = Eigen::Affine3d::Identity();
  mirror.linear()(0, 0) = -1;
  rasteriser->Begin({});
  rasteriser->Draw(towards.View(), mirror, 0, Faces::kFrontOnly);
  EXPECT_GT(cv::countNonZero(rasteriser->Finish().depth_m), 0);
}

TEST_P(RasteriserTest, DepthAloneMatchesDepthWithIds) {
  auto rasteriser = Make(StrongLens());
  const Mesh wall = Quad({-4, -4, 3}, {8, 0, 1}, {0, 8, 0}, 40);
  const cv::Mat1f with_ids = DepthOf(*rasteriser, wall);
  rasteriser->Begin({});
  rasteriser->DrawDepth(wall.View(), kHere, Faces::kBoth);
  const VisibilityBuffer& seen = rasteriser->Finish();
  EXPECT_EQ(cv::norm(with_ids, seen.depth_m, cv::NORM_INF), 0);
  EXPECT_EQ(cv::countNonZero(seen.triangle != -1), 0);
}

TEST(PictureGrid, FinerGridsKeepThePictureInPlace) {
  const PinholeCamera camera = StrongLens();
  const cv::Rect region(100, 50, 64, 40);
  for (const int scale : {1, 2, 4}) {
    const PinholeCamera grid = PictureGrid{scale, region}.CameraOf(camera);
    EXPECT_EQ(grid.width, 64 * scale);
    EXPECT_EQ(grid.height, 40 * scale);
    const Eigen::Vector3d p(-0.4, -0.25, 1.1);
    const Eigen::Vector2d in_picture = *camera.Project(p);
    const Eigen::Vector2d in_grid = *grid.Project(p);
    // Grid pixel k's centre lies at (k + 0.5) / scale - 0.5 of the region.
    EXPECT_NEAR((in_grid.x() + 0.5) / scale - 0.5 + region.x, in_picture.x(), 1e-9);
    EXPECT_NEAR((in_grid.y() + 0.5) / scale - 0.5 + region.y, in_picture.y(), 1e-9);
  }
}

TEST_P(RasteriserTest, CoverageOfFinerGridsIsTheArea) {
  // Undistorted, one picture pixel = 1 cm at 1 m: the quad covers exactly 10.25 x 7.5 pixels.
  const PinholeCamera camera{.width = 64, .height = 64, .fx = 100, .fy = 100, .cx = 31.5, .cy = 31.5};
  auto rasteriser = Make(camera);
  const Mesh quad = Quad({-0.0500f, -0.0400f, 1}, {0.1025f, 0, 0}, {0, 0.075f, 0});
  rasteriser->Begin({.scale = 4, .region_px = {16, 16, 32, 32}});
  rasteriser->Draw(quad.View(), kHere, 0, Faces::kBoth);
  const VisibilityBuffer& seen = rasteriser->Finish();
  EXPECT_EQ(seen.depth_m.cols, 128);
  // x from 26.5 to 36.75 px: picture pixels 27..36 whole and a quarter of 37; 16 grid pixels to a picture
  // pixel.
  EXPECT_EQ(cv::countNonZero(seen.depth_m), 41 * 30);
  auto covered = [&](int u, int v) {
    return cv::countNonZero(seen.depth_m(cv::Rect(4 * (u - 16), 4 * (v - 16), 4, 4)));
  };
  EXPECT_EQ(covered(27, 30), 16);
  EXPECT_EQ(covered(26, 30), 0);
  EXPECT_EQ(covered(37, 30), 4);
  EXPECT_EQ(covered(30, 35), 8);
}

TEST_P(RasteriserTest, ARegionShowsWhatTheWholePictureShows) {
  const PinholeCamera camera = StrongLens();
  auto rasteriser = Make(camera);
  const Mesh wall = Quad({-4, -4, 3}, {8, 0, 1}, {0, 8, 0}, 30);
  const cv::Mat1f whole = DepthOf(*rasteriser, wall);
  const cv::Rect region(411, 97, 53, 61);
  rasteriser->Begin({.scale = 1, .region_px = region});
  rasteriser->Draw(wall.View(), kHere, 0, Faces::kBoth);
  // Corners are rounded anew on the shifted grid: the last bits of 1/z differ.
  EXPECT_LT(cv::norm(whole(region), rasteriser->Finish().depth_m, cv::NORM_INF), 1e-4);
}

TEST(CreateRasteriser, NamesWhatIsWrong) {
  PinholeCamera camera = StrongLens();
  camera.fx = 0;
  auto bad = CreateRasteriser(RasterBackend::kCpu, camera, {});
  ASSERT_FALSE(bad);
  EXPECT_NE(bad.error().message.find("fx"), std::string::npos);
  EXPECT_FALSE(CreateRasteriser(RasterBackend::kCpu, StrongLens(), {.near_m = 0}));
}

TEST(TrianglePlane, FindsDepthAndWeightsOfAPointInsideThroughItsRay) {
  std::mt19937 random(6);
  std::uniform_real_distribution<float> side(-1, 1), weight(0, 1);
  for (int i = 0; i < 1000; ++i) {
    auto corner = [&] { return Eigen::Vector3f(side(random), side(random), 3 + side(random)); };
    const Eigen::Vector3f a = corner();
    // From decimetres down to the millimetres of a fine model.
    const float size = i % 2 == 0 ? 0.3f : 0.005f;
    const Eigen::Vector3f b = a + size * Eigen::Vector3f(1, side(random), side(random));
    const Eigen::Vector3f c = a + size * Eigen::Vector3f(side(random), 2, side(random));
    float wb = weight(random), wc = weight(random);
    if (wb + wc > 1) wb = 1 - wb, wc = 1 - wc;
    const Eigen::Vector3f p = a + wb * (b - a) + wc * (c - a);
    const auto found = TrianglePlane(a, b, c).At(p.head<2>() / p.z());
    ASSERT_TRUE(found);
    // A plane seen edge-on turns the ray's rounding into a long way.
    const Eigen::Vector3f n = (b - a).cross(c - a).normalized();
    if (std::abs(n.dot(p.normalized())) < 0.05f) continue;
    EXPECT_NEAR(found->depth_m, p.z(), 3e-5);
    EXPECT_NEAR(found->b, wb, 2e-5 / size);
    EXPECT_NEAR(found->c, wc, 2e-5 / size);
  }
}

TEST(TrianglePlane, HasNoPointForNoAreaOrBehind) {
  EXPECT_FALSE(TrianglePlane({0, 0, 1}, {1, 1, 1}, {2, 2, 1}).At({0, 0}));
  EXPECT_FALSE(TrianglePlane({0, 0, -1}, {1, 0, -1}, {0, 1, -1}).At({0.1f, 0.1f}));
  EXPECT_FALSE(TrianglePlane({0, 0, 1}, {0, 0, 2}, {0, 1, 1}).At({0, 0.5f}));
}

}  // namespace
}  // namespace mixstage
