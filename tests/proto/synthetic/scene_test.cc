// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/synthetic/room_plan.h"
#include "tests/proto/synthetic/small_set.h"

namespace mixstage {
namespace {

using Eigen::Vector3d;

constexpr double kWaving_s = 13.5, kWalking_s = 6.2, kEmpty_s = 1.0;

double MeanDifference(const cv::Mat1b& a, const cv::Mat1b& b) {
  cv::Mat1b d;
  cv::absdiff(a, b, d);
  return cv::mean(d)[0];
}

TEST(SyntheticScene, RoomIsAsThePlanSays) {
  const SyntheticScene& set = QuietSet();
  const Vector3d eye(0, 0, 1.4);
  EXPECT_NEAR(set.Trace({eye, -Vector3d::UnitZ()}, kEmpty_s).range_m, 1.4, 1e-9);
  EXPECT_NEAR(set.Trace({eye, Vector3d::UnitZ()}, kEmpty_s).range_m, room_plan::kCeilingZ - 1.4, 1e-9);
  EXPECT_NEAR(set.Trace({{0, -3, 2.4}, Vector3d::UnitX()}, kEmpty_s).range_m, room_plan::kBackX, 1e-9);
  // Through the window's opening to the pane.
  const Hit pane = set.Trace({{3.5, 0, 1.6}, Vector3d::UnitY()}, kEmpty_s);
  EXPECT_NEAR(pane.range_m, room_plan::kPaneY, 1e-9);
  EXPECT_EQ(pane.surface, Surface::kPane);
  // Every ray from inside ends, faces the eye and leaves again.
  for (int i = 0; i < 2000; ++i) {
    const Vector3d d = Vector3d(std::sin(1.1 * i), std::cos(1.7 * i), std::sin(0.37 * i)).normalized();
    const Hit hit = set.Trace({eye, d}, kEmpty_s);
    EXPECT_TRUE(hit.range_m > 0 && hit.range_m < 9) << i;
    EXPECT_LE(hit.normal.dot(d), 1e-9) << i;
    EXPECT_NEAR(hit.normal.norm(), 1, 1e-9);
  }
}

TEST(SyntheticScene, SpotsForObjectsAreFree) {
  const SyntheticScene& set = QuietSet();
  for (const Vector3d& spot : {room_plan::kNearSpot, room_plan::kFarSpot}) {
    for (int i = 0; i < 24; ++i) {
      const double turn = 2 * 3.14159265 * i / 24;
      const Vector3d rim = spot + 0.28 * Vector3d(std::cos(turn), std::sin(turn), 0);
      for (double t = 0; t < kLoop_s; t += 0.5) {
        EXPECT_NEAR(set.Trace({rim + Vector3d(0, 0, 1), -Vector3d::UnitZ()}, t).range_m, 1, 1e-9) << t;
      }
    }
  }
}

TEST(SyntheticScene, DepthIsTheTraceOfEveryPixel) {
  const SyntheticScene& set = QuietSet();
  for (const SyntheticCamera camera : {SyntheticCamera::kColor, SyntheticCamera::kDepth}) {
    const cv::Mat1f depth = set.TruthDepth(camera, kWaving_s);
    int figure = 0;
    for (int v = 0; v < depth.rows; v += 7) {
      for (int u = 0; u < depth.cols; u += 5) {
        const auto truth = set.TruthAt(camera, u, v, kWaving_s);
        ASSERT_TRUE(truth.has_value());
        EXPECT_FLOAT_EQ(depth(v, u), truth->depth_m);
        figure += truth->figure ? 1 : 0;
        const auto empty = set.TruthAt(camera, u, v, kEmpty_s);
        EXPECT_LE(truth->depth_m, empty->depth_m);
        EXPECT_FALSE(empty->figure);
      }
    }
    EXPECT_GT(figure, 10);
  }
}

TEST(SyntheticScene, APointSeenByOneCameraIsWhereTheOtherOneSeesIt) {
  const SyntheticScene& set = QuietSet();
  const Rig& rig = set.rig();
  int compared = 0;
  for (int v = 20; v < 130; v += 10) {
    for (int u = 30; u < 150; u += 10) {
      const auto here = set.TruthAt(SyntheticCamera::kDepth, u, v, kWaving_s);
      const auto n = rig.depth->camera.Unproject({u, v});
      const Vector3d p =
          rig.T_color_depth * Vector3d(here->depth_m * n->x(), here->depth_m * n->y(), here->depth_m);
      const auto pixel = rig.color.Project(p);
      if (!pixel || pixel->x() < 0 || pixel->y() < 0 || pixel->x() > 249 || pixel->y() > 186) continue;
      const auto there = set.TruthAt(SyntheticCamera::kColor, pixel->x(), pixel->y(), kWaving_s);
      // Never farther; nearer only where something hides it from the other camera.
      EXPECT_LT(there->depth_m, p.z() + 1e-4);
      compared += std::abs(there->depth_m - p.z()) < 1e-4 ? 1 : 0;
    }
  }
  EXPECT_GT(compared, 80);
}

TEST(SyntheticScene, MatteCoversExactlyWhatTheFigureIsNearestIn) {
  const SyntheticScene& set = QuietSet();
  const cv::Mat1b matte = set.TruthMatte(kWaving_s);
  const cv::Mat1f with = set.TruthDepth(SyntheticCamera::kColor, kWaving_s);
  const cv::Mat1f without = set.TruthDepth(SyntheticCamera::kColor, kEmpty_s);
  int inside = 0;
  int border = 0;
  for (int v = 0; v < matte.rows; ++v) {
    for (int u = 0; u < matte.cols; ++u) {
      const bool figure = with(v, u) < without(v, u);
      if (matte(v, u) == 255 || matte(v, u) == 0) {
        EXPECT_EQ(figure, matte(v, u) == 255) << u << " " << v;
      }
      inside += matte(v, u) == 255 ? 1 : 0;
      border += matte(v, u) != 0 && matte(v, u) != 255 ? 1 : 0;
    }
  }
  EXPECT_GT(inside, 1500);
  EXPECT_GT(border, 200);
  EXPECT_EQ(cv::countNonZero(set.TruthMatte(kEmpty_s)), 0);
}

// The picture's own antialiasing against the truth: with a figure of one colour before another, coverage can
// be read from the picture, but cloth has many; so only that pixels of no coverage and no shadow did not
// change and that covered ones did.
TEST(SyntheticScene, PictureChangesWhereTheFigureOrHisShadowIsAndNowhereElse) {
  SyntheticScene& set = QuietSet();
  YuvImage empty;
  YuvImage with;
  set.RenderColor(kEmpty_s, empty);
  set.RenderColor(kWalking_s, with);
  const cv::Mat1b matte = set.TruthMatte(kWalking_s);
  const cv::Mat1b label = set.TruthLabel(kWalking_s);
  int changed_inside = 0;
  int inside = 0;
  int shadow = 0;
  int darker = 0;
  int brighter = 0;
  double outside = 0;
  int outside_count = 0;
  for (int v = 0; v < matte.rows; ++v) {
    for (int u = 0; u < matte.cols; ++u) {
      const int difference = with.y(v, u) - empty.y(v, u);
      if (matte(v, u) == 255) {
        ++inside;
        changed_inside += std::abs(difference) > 4 ? 1 : 0;
      } else if (matte(v, u) == 0) {
        brighter += difference > 1 ? 1 : 0;
        if (label(v, u) == 2) {
          ++shadow;
          darker += difference < 0 ? 1 : 0;
        } else if (label(v, u) == 0) {
          outside += std::abs(difference);
          ++outside_count;
        }
      }
    }
  }
  // He takes light away and adds none, but for a pixel whose corner he touches between the truth's rays.
  EXPECT_LE(brighter, 2);
  EXPECT_GT(changed_inside, inside * 7 / 10);
  EXPECT_GT(shadow, 200);
  EXPECT_GT(darker, shadow * 9 / 10);
  EXPECT_LT(outside / outside_count, 1.5);
}

TEST(SyntheticScene, EmptySetIsTheSamePictureBeforeAndAfterHeWalkedThrough) {
  SyntheticScene& set = QuietSet();
  YuvImage first;
  YuvImage walking;
  YuvImage after;
  set.RenderColor(0.0, first);
  set.RenderColor(kWalking_s, walking);
  EXPECT_GT(MeanDifference(first.y, walking.y), 0.5);
  for (const double t : {2.9, 22.5, 24.0}) {
    set.RenderColor(t, after);
    EXPECT_EQ(MeanDifference(first.y, after.y), 0) << t;
    EXPECT_EQ(MeanDifference(first.cb, after.cb), 0) << t;
    EXPECT_EQ(MeanDifference(first.cr, after.cr), 0) << t;
  }
}

TEST(SyntheticScene, AFrameDoesNotDependOnTheFramesBeforeIt) {
  SyntheticScene& set = QuietSet();
  YuvImage straight;
  YuvImage after_others;
  set.RenderColor(kWaving_s, straight);
  for (const double t : {kWalking_s, kEmpty_s, 19.0}) set.RenderColor(t, after_others);
  set.RenderColor(kWaving_s, after_others);
  EXPECT_EQ(MeanDifference(straight.y, after_others.y), 0);
  EXPECT_EQ(MeanDifference(straight.cb, after_others.cb), 0);
  set.RenderColor(kWaving_s + kLoop_s, after_others);  // without noise the loop repeats to the byte
  EXPECT_EQ(MeanDifference(straight.y, after_others.y), 0);
}

TEST(SyntheticScene, SameSeedAndTimeGiveTheSameBytesAndNoiseIsNewInEveryFrame) {
  auto a = SyntheticScene::Create(SmallRig(), {.seed = 5});
  auto b = SyntheticScene::Create(SmallRig(), {.seed = 5});
  ASSERT_TRUE(a && b);
  YuvImage ya;
  YuvImage yb;
  cv::Mat1w ra, rb, aa, ab;
  a->RenderColor(8.04, ya);
  b->RenderColor(3.5, yb);
  b->RenderColor(8.04, yb);
  EXPECT_EQ(MeanDifference(ya.y, yb.y), 0);
  EXPECT_EQ(MeanDifference(ya.cr, yb.cr), 0);
  a->RenderTof(8.04, ra, aa);
  b->RenderTof(8.04, rb, ab);
  EXPECT_EQ(cv::countNonZero(ra != rb), 0);
  EXPECT_EQ(cv::countNonZero(aa != ab), 0);
  // Two pictures of the empty set differ by noise alone: about 1 to 2.5 counts.
  a->RenderColor(1.0, ya);
  a->RenderColor(1.0 + 1.0 / 30, yb);
  cv::Mat1f difference;
  cv::subtract(ya.y, yb.y, difference, cv::noArray(), CV_32F);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(difference, mean, deviation);
  EXPECT_NEAR(mean[0], 0, 0.05);
  EXPECT_GT(deviation[0] / std::sqrt(2.0), 0.8);
  EXPECT_LT(deviation[0] / std::sqrt(2.0), 2.5);
}

TEST(SyntheticScene, PictureIsWellExposed) {
  SyntheticScene& set = QuietSet();
  YuvImage picture;
  set.RenderColor(kEmpty_s, picture);
  EXPECT_EQ(picture.layout, ChromaLayout::k420);
  EXPECT_EQ(picture.cb.size(), cv::Size(125, 94));
  const double mean = cv::mean(picture.y)[0];
  EXPECT_GT(mean, 80);
  EXPECT_LT(mean, 160);
  EXPECT_LT(cv::countNonZero(picture.y > 252), picture.y.total() / 12);  // the window's sky at most
  EXPECT_LT(cv::countNonZero(picture.y < 12), picture.y.total() / 50);
}

TEST(SyntheticScene, ARigThatCannotSeeIsRefusedByField) {
  Rig rig = SmallRig();
  rig.color.fx = 0;
  const auto scene = SyntheticScene::Create(rig, {});
  ASSERT_FALSE(scene.has_value());
  EXPECT_NE(scene.error().message.find("cameras.color.fx"), std::string::npos) << scene.error().message;
}

}  // namespace
}  // namespace mixstage
