// SPDX-License-Identifier: Apache-2.0
//
// The warp on both back ends. Cells and their corners are the same to the bit; what may differ is to which
// triangle a pixel belongs whose centre an edge hits, and the last digits of 1/z (tolerances as in
// egl_rasteriser_test.cc).
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "server/depth/depth_warp.h"
#include "tests/support/egl_or_skip.h"

namespace mixstage {
namespace {

RenderDevice Egl() { return {RasterBackend::kEgl, test::SharedGpu()}; }

void ExpectSame(const cv::Mat1f& cpu, const cv::Mat1f& egl, int least_known) {
  ASSERT_EQ(cpu.size(), egl.size());
  int known = 0, outline = 0, far_apart = 0;
  for (int y = 0; y < cpu.rows; ++y) {
    for (int x = 0; x < cpu.cols; ++x) {
      const float a = cpu(y, x), b = egl(y, x);
      known += a > 0;
      outline += (a > 0) != (b > 0);
      if (a > 0 && b > 0) far_apart += std::abs(b / a - 1) > 1e-4f;
    }
  }
  EXPECT_GE(known, least_known);
  EXPECT_LE(outline, 1 + known / 1000);
  EXPECT_LE(far_apart, 1 + known / 1000);
}

// Both cameras of the synthetic rig at a quarter of the colour camera's size.
Rig SmallRig() {
  Rig rig = SyntheticRig();
  PinholeCamera& c = rig.color;
  c.width /= 4, c.height /= 4;
  c.fx /= 4, c.fy /= 4;
  c.cx = (c.cx + 0.5) / 4 - 0.5, c.cy = (c.cy + 0.5) / 4 - 0.5;
  return rig;
}

class EglGridScanTest : public testing::Test {
 protected:
  void SetUp() override { MIXSTAGE_SKIP_WITHOUT_EGL(); }
  static cv::Mat1f Warp(DepthWarp& warp, const Rig& rig, const cv::Mat1w& raw, const cv::Mat1w& amplitude) {
    cv::Mat1f depth_m(rig.color.height, rig.color.width);
    EXPECT_TRUE(warp.Run(View(raw), View(amplitude), View(depth_m)));
    return depth_m;
  }
};

TEST_F(EglGridScanTest, SyntheticTofPicturesAreWarpedAlike) {
  const Rig rig = SmallRig();
  auto scene = SyntheticScene::Create(rig, {});
  ASSERT_TRUE(scene);
  auto cpu = *DepthWarp::Create(rig, {});
  auto egl = *DepthWarp::Create(rig, {}, Egl());
  for (const double t_s : {0.5, 4.0, 5.2}) {
    cv::Mat1w range, amplitude;
    scene->RenderTof(t_s, range, amplitude);
    ExpectSame(Warp(cpu, rig, range, amplitude), Warp(egl, rig, range, amplitude), 20'000);
    ExpectSame(Warp(cpu, rig, range, {}), Warp(egl, rig, range, {}), 20'000);
  }
}

TEST_F(EglGridScanTest, PicturesOfNoiseAreTornAlike) {
  const Rig rig = SmallRig();
  auto cpu = *DepthWarp::Create(rig, {});
  auto egl = *DepthWarp::Create(rig, {}, Egl());
  std::mt19937 random(3);
  cv::Mat1w raw(rig.depth->camera.height, rig.depth->camera.width);
  for (const unsigned smooth : {0u, 200u, 2000u}) {
    for (int y = 0; y < raw.rows; ++y) {
      for (int x = 0; x < raw.cols; ++x) {
        const auto noise = smooth == 0 ? random() % 20000 : 8000 + random() % smooth;
        raw(y, x) = static_cast<std::uint16_t>(random() % 9 == 0 ? 0 : noise);
      }
    }
    ExpectSame(Warp(cpu, rig, raw, {}), Warp(egl, rig, raw, {}), 0);
  }
}

TEST_F(EglGridScanTest, TheNearPlaneCutsAlike) {
  Rig rig = SmallRig();
  // The colour camera stands so far in front that half of the ramp is behind its near plane.
  rig.T_color_depth.translation().z() = -1.5;
  auto cpu = *DepthWarp::Create(rig, {});
  auto egl = *DepthWarp::Create(rig, {}, Egl());
  cv::Mat1w raw(rig.depth->camera.height, rig.depth->camera.width);
  for (int y = 0; y < raw.rows; ++y) {
    for (int x = 0; x < raw.cols; ++x) {
      raw(y, x) = static_cast<std::uint16_t>(std::lround((1.0 + 2.0 * x / raw.cols) / rig.depth->unit_m));
    }
  }
  ExpectSame(Warp(cpu, rig, raw, {}), Warp(egl, rig, raw, {}), 500);
}

TEST_F(EglGridScanTest, ALostContextCostsNoPicture) {
  const Rig rig = SmallRig();
  auto gpu = *gl::Gpu::Create();
  auto cpu = *DepthWarp::Create(rig, {});
  auto egl = *DepthWarp::Create(rig, {}, {RasterBackend::kEgl, gpu});
  const cv::Mat1w raw(rig.depth->camera.height, rig.depth->camera.width,
                      static_cast<std::uint16_t>(std::lround(2.0 / rig.depth->unit_m)));
  const cv::Mat1f truth = Warp(cpu, rig, raw, {});
  for (int i = 0; i < 3; ++i) {
    gpu->LoseForTest();
    ExpectSame(truth, Warp(egl, rig, raw, {}), 20'000);
  }
}

TEST_F(EglGridScanTest, TheSmallestPicturesAreHarmless) {
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(2, 1), cv::Size(1, 3), cv::Size(2, 2)}) {
    Rig rig = SmallRig();
    rig.color = {.width = 3, .height = 2, .fx = 5, .fy = 5, .cx = 1, .cy = 0.5};
    rig.depth->camera = {.width = size.width, .height = size.height, .fx = 5, .fy = 5, .cx = 0, .cy = 0};
    auto cpu = *DepthWarp::Create(rig, {});
    auto egl = *DepthWarp::Create(rig, {}, Egl());
    const cv::Mat1w raw(size, std::uint16_t{8000});
    ExpectSame(Warp(cpu, rig, raw, {}), Warp(egl, rig, raw, {}), 0);
  }
}

}  // namespace
}  // namespace mixstage
