// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "proto/synthetic/scene.h"
#include "proto/synthetic/tof_view.h"
#include "tests/proto/synthetic/small_set.h"

namespace mixstage {
namespace {

// True range along every pixel's central ray, and how much it varies over the pixel's neighbours.
struct Truth {
  cv::Mat1f range_m, step_m;
};

Truth RangesOf(const SyntheticScene& set, double time_s) {
  const PinholeCamera& c = set.rig().depth->camera;
  const cv::Mat1f z = set.TruthDepth(SyntheticCamera::kDepth, time_s);
  Truth truth{cv::Mat1f(z.size()), cv::Mat1f(z.size(), 1.f)};
  for (int v = 0; v < z.rows; ++v) {
    for (int u = 0; u < z.cols; ++u) {
      const auto n = c.Unproject({u, v});
      truth.range_m(v, u) = z(v, u) * static_cast<float>(std::sqrt(1 + n->squaredNorm()));
    }
  }
  for (int v = 1; v + 1 < z.rows; ++v) {
    for (int u = 1; u + 1 < z.cols; ++u) {
      float step = 0;
      for (int dv = -1; dv <= 1; ++dv) {
        for (int du = -1; du <= 1; ++du) {
          step = std::max(step, std::abs(truth.range_m(v + dv, u + du) - truth.range_m(v, u)));
        }
      }
      truth.step_m(v, u) = step;
    }
  }
  return truth;
}

TEST(TofView, WithoutNoiseReportsTrueRangePlusItsErrorCurveOnSmoothSurfaces) {
  SyntheticScene& set = QuietSet();
  const DepthCamera& camera = *set.rig().depth;
  cv::Mat1w range, amplitude;
  for (const double t : {1.0, 13.5}) {
    set.RenderTof(t, range, amplitude);
    const Truth truth = RangesOf(set, t);
    int smooth = 0;
    int off = 0;
    for (int v = 0; v < range.rows; ++v) {
      for (int u = 0; u < range.cols; ++u) {
        if (truth.step_m(v, u) > 0.03f) continue;
        ++smooth;
        const double expected = truth.range_m(v, u) + camera.range_error.At(truth.range_m(v, u));
        // Thin things (a book's edge, a brow) lie between the pixels that were looked at: one in a hundred.
        off += std::abs(range(v, u) * camera.unit_m - expected) > 0.012 ? 1 : 0;
      }
    }
    EXPECT_GT(smooth, 7'000);
    EXPECT_LT(off, smooth / 100) << t;
  }
}

TEST(TofView, PixelsOnAnOutlineMixFigureAndRoom) {
  SyntheticScene& set = QuietSet();
  const DepthCamera& camera = *set.rig().depth;
  cv::Mat1w range, amplitude;
  set.RenderTof(13.5, range, amplitude);
  const Truth truth = RangesOf(set, 13.5);
  int between = 0;
  for (int v = 1; v + 1 < range.rows; ++v) {
    for (int u = 1; u + 1 < range.cols; ++u) {
      const float left = truth.range_m(v, u - 1);
      const float right = truth.range_m(v, u + 1);
      if (std::abs(left - right) < 0.8f) continue;
      const double m = range(v, u) * camera.unit_m;
      between += m > std::min(left, right) + 0.15 && m < std::max(left, right) - 0.15 ? 1 : 0;
    }
  }
  EXPECT_GT(between, 25);
}

TEST(TofView, RangesBeyondTheAmbiguityWrap) {
  Rig rig = SmallRig();
  rig.depth->unambiguous_range_m = 3.0;
  rig.depth->range_error = {};
  auto set = SyntheticScene::Create(rig, {.noise = SensorNoise::kNone});
  ASSERT_TRUE(set.has_value());
  cv::Mat1w range, amplitude;
  set->RenderTof(1.0, range, amplitude);
  const Truth truth = RangesOf(*set, 1.0);
  int wrapped = 0;
  for (int v = 0; v < range.rows; v += 3) {
    for (int u = 0; u < range.cols; u += 3) {
      const double m = range(v, u) * rig.depth->unit_m;
      EXPECT_LE(m, 3.0);
      if (truth.step_m(v, u) > 0.03f || truth.range_m(v, u) < 3.2f) continue;
      wrapped += std::abs(std::remainder(m - truth.range_m(v, u), 3.0)) < 0.012 ? 1 : 0;
    }
  }
  EXPECT_GT(wrapped, 500);
}

TEST(TofView, DepthCamerasThatMeasureZReportZ) {
  Rig rig = SmallRig();
  rig.depth->measures = DepthMeasure::kZ;
  rig.depth->range_error = {};
  rig.depth->unambiguous_range_m.reset();
  auto set = SyntheticScene::Create(rig, {.noise = SensorNoise::kNone});
  ASSERT_TRUE(set.has_value());
  cv::Mat1w range, amplitude;
  set->RenderTof(13.5, range, amplitude);
  const cv::Mat1f z = set->TruthDepth(SyntheticCamera::kDepth, 13.5);
  const Truth truth = RangesOf(*set, 13.5);
  int smooth = 0;
  int right = 0;
  for (int v = 0; v < range.rows; ++v) {
    for (int u = 0; u < range.cols; ++u) {
      if (truth.step_m(v, u) > 0.03f) continue;
      ++smooth;
      right += std::abs(range(v, u) * rig.depth->unit_m - z(v, u)) < 0.012 ? 1 : 0;
    }
  }
  EXPECT_GT(right, smooth * 99 / 100);
}

TEST(TofView, NoiseGrowsWithDistanceFromMillimetresToCentimetres) {
  auto set = SyntheticScene::Create(SmallRig(), {.seed = 3});
  ASSERT_TRUE(set.has_value());
  const double unit_m = set->rig().depth->unit_m;
  constexpr int kFrames = 40;
  std::vector<cv::Mat1w> frames(kFrames);
  cv::Mat1w amplitude;
  for (int i = 0; i < kFrames; ++i)
    set->RenderTof(0.08 * (i % 36) + kLoop_s * (i / 36), frames[static_cast<std::size_t>(i)], amplitude);
  const Truth truth = RangesOf(*set, 1.0);
  auto deviation_m = [&](int u, int v) {
    double sum = 0;
    double squares = 0;
    for (const cv::Mat1w& frame : frames) {
      const double m = frame(v, u) * unit_m;
      sum += m;
      squares += m * m;
    }
    return std::sqrt(std::max(0.0, squares / kFrames - sum * sum / kFrames / kFrames));
  };
  double near_sum = 0;
  double far_sum = 0;
  int near_count = 0;
  int far_count = 0;
  for (int v = 0; v < truth.range_m.rows; ++v) {
    for (int u = 80; u < truth.range_m.cols; ++u) {  // right of the window's glass
      if (truth.range_m(v, u) < 3.0f) {
        near_sum += deviation_m(u, v);
        ++near_count;
      } else if (truth.range_m(v, u) > 5.3f && truth.range_m(v, u) < 6.3f && v < 70) {
        far_sum += deviation_m(u, v);
        ++far_count;
      }
    }
  }
  ASSERT_GT(near_count, 100);
  ASSERT_GT(far_count, 100);
  EXPECT_GT(near_sum / near_count, 0.004);
  EXPECT_LT(near_sum / near_count, 0.06);
  EXPECT_GT(far_sum / far_count, 0.015);
  EXPECT_LT(far_sum / far_count, 0.08);
  EXPECT_LT(TofView::RangeNoise_m(0.5f), 0.006f);
  for (float light = 0.004f; light < 1; light *= 1.5f) {
    EXPECT_GT(TofView::RangeNoise_m(light), TofView::RangeNoise_m(light * 1.5f));
  }
}

TEST(TofView, AmplitudeFallsWithDistance) {
  SyntheticScene& set = QuietSet();
  cv::Mat1w range, amplitude;
  set.RenderTof(13.5, range, amplitude);
  const Truth truth = RangesOf(set, 13.5);
  double near_sum = 0;
  double far_sum = 0;
  int near_count = 0;
  int far_count = 0;
  for (int v = 0; v < range.rows; ++v) {
    for (int u = 0; u < range.cols; ++u) {
      const auto at = set.TruthAt(SyntheticCamera::kDepth, u, v, 13.5);
      if (at->figure) {
        near_sum += amplitude(v, u);
        ++near_count;
      } else if (truth.range_m(v, u) > 5) {
        far_sum += amplitude(v, u);
        ++far_count;
      }
    }
  }
  EXPECT_GT(near_sum / near_count, 1.5 * far_sum / far_count);
}

}  // namespace
}  // namespace mixstage
