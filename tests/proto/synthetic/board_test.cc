// SPDX-License-Identifier: Apache-2.0
//
// Boards in the synthetic room against their projections, and what a turned head sees against its truth.
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "proto/synthetic/rig.h"
#include "proto/synthetic/scene.h"
#include "proto/synthetic/views.h"
#include "tests/proto/synthetic/small_set.h"

namespace mixstage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// Half the size: a board's squares keep the pixels that finding a corner takes.
Rig HalfRig() {
  Rig rig = SyntheticRig();
  rig.color.width = 512;
  rig.color.height = 384;
  for (double* value : {&rig.color.fx, &rig.color.fy, &rig.color.cx, &rig.color.cy}) *value *= 0.5;
  return rig;
}

SyntheticScene& HalfSet() {
  static SyntheticScene scene = [] {
    auto created =
        SyntheticScene::Create(HalfRig(), {.seed = 7, .noise = SensorNoise::kNone, .figure = false});
    EXPECT_TRUE(created.has_value());
    return std::move(*created);
  }();
  return scene;
}

StandingBoard BoardAt(const RigidTransform& T_world_camera, const Vector3d& first_corner, double turn_rad) {
  StandingBoard board{{"a", 8, 5, 0.08, 0.055}, T_world_camera};
  board.T_world_board.translate(first_corner);
  board.T_world_board.rotate(Eigen::AngleAxisd(turn_rad, Vector3d(0.3, 1, 0.1).normalized()));
  return board;
}

// How far corners found in a picture are from where they are projected to, px; those outside the picture are
// left out. Finding one corner at sharp edges is good to a twentieth of a pixel, whatever the picture; the
// mean says whether the picture is right.
struct CornerErrors {
  std::size_t count = 0;
  double mean_distance_px = 0, distance_of_mean_px = 0;
};
template <typename Camera>
CornerErrors CornerErrorsOf(const cv::Mat1b& picture, const Camera& camera,
                            const RigidTransform& T_world_camera, const StandingBoard& board,
                            double least_angle_deg = 0) {
  std::vector<cv::Point2f> expected;
  for (int j = 0; j < board.board.rows; ++j) {
    for (int i = 0; i < board.board.columns; ++i) {
      const Vector3d p = T_world_camera.inverse() * board.T_world_board *
                         Vector3d(board.board.square_m * i, board.board.square_m * j, 0);
      const double angle_deg = std::atan2(p.head<2>().norm(), p.z()) * 180 / M_PI;
      const auto q = camera.Project(p);
      if (!q || angle_deg < least_angle_deg || q->x() < 8 || q->y() < 8 || q->x() > camera.width - 9 ||
          q->y() > camera.height - 9) {
        continue;
      }
      expected.emplace_back(static_cast<float>(q->x()), static_cast<float>(q->y()));
    }
  }
  if (expected.empty()) return {};
  std::vector<cv::Point2f> found = expected;
  cv::cornerSubPix(picture, found, {3, 3}, {-1, -1},
                   {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 50, 1e-4});
  CornerErrors errors{.count = found.size()};
  const auto n = static_cast<double>(found.size());
  cv::Point2d sum(0, 0);
  for (std::size_t i = 0; i < found.size(); ++i) {
    sum += cv::Point2d(found[i] - expected[i]);
    errors.mean_distance_px += cv::norm(found[i] - expected[i]) / n;
  }
  errors.distance_of_mean_px = cv::norm(sum) / n;
  return errors;
}

TEST(BoardView, CornersLieWhereTheColourCameraProjectsThem) {
  SyntheticScene& set = HalfSet();
  set.Arrange(0, 0);
  const StandingBoard board = BoardAt(set.TruthPose(), {-0.31, -0.22, 1.45}, 0.4);
  set.Arrange(0, 0, {board});
  YuvImage picture;
  set.RenderColor(0, picture);
  const CornerErrors errors = CornerErrorsOf(picture.y, set.rig().color, set.TruthPose(), board);
  ASSERT_EQ(errors.count, 40u);
  EXPECT_LT(errors.distance_of_mean_px, 0.015);
  EXPECT_LT(errors.mean_distance_px, 0.08);
}

TEST(BoardView, CornersLieWhereTheFisheyeProjectsThemAlsoBehindNinetyDegrees) {
  SyntheticScene& set = HalfSet();
  set.Arrange(0, 0);
  const FisheyeCamera& fisheye = *set.rig().fisheye;
  const RigidTransform T_world_fisheye = set.TruthPose() * set.rig().T_color_fisheye;
  YuvImage picture;
  // In front, and a board around the left edge of the lens' circle that faces the camera.
  const StandingBoard front = BoardAt(T_world_fisheye, {-0.3, -0.2, 0.8}, 0.2);
  StandingBoard side{{"a", 8, 5, 0.08, 0.055}, T_world_fisheye};
  side.T_world_board.rotate(Eigen::AngleAxisd(-M_PI / 2, Vector3d::UnitY()));
  side.T_world_board.translate(Vector3d(-0.28, -0.16, 0.9));
  set.Arrange(0, 0, {front, side});
  set.RenderFisheye(0, picture);
  const CornerErrors ahead = CornerErrorsOf(picture.y, fisheye, T_world_fisheye, front);
  ASSERT_EQ(ahead.count, 40u);
  EXPECT_LT(ahead.distance_of_mean_px, 0.015);
  EXPECT_LT(ahead.mean_distance_px, 0.08);
  const CornerErrors behind = CornerErrorsOf(picture.y, fisheye, T_world_fisheye, side, 90);
  ASSERT_GE(behind.count, 5u);
  EXPECT_LT(behind.distance_of_mean_px, 0.06);
  EXPECT_LT(behind.mean_distance_px, 0.15);
}

TEST(FisheyeView, IsBlackOutsideItsCircle) {
  SyntheticScene& set = HalfSet();
  set.Arrange(0, 0);
  YuvImage picture;
  set.RenderFisheye(0, picture);
  const FisheyeCamera& fisheye = *set.rig().fisheye;
  int outside = 0;
  for (int v = 0; v < picture.height(); ++v) {
    for (int u = 0; u < picture.width(); ++u) {
      if (fisheye.Unproject(Vector2d(u, v))) continue;
      ++outside;
      ASSERT_LE(picture.y(v, u), 1) << u << ", " << v;
    }
  }
  EXPECT_GT(outside, 60'000);
}

// Ranges without noise against rays through the exact scene, where the surface is smooth.
TEST(TofView, OfATurnedHeadReportsTheTrueRange) {
  SyntheticScene& set = HalfSet();
  const Rig& rig = set.rig();
  const DepthCamera& camera = *rig.depth;
  for (const auto& [pan_deg, tilt_deg] : {std::pair(31.0, -7.0), std::pair(-24.0, 18.0)}) {
    set.Arrange(pan_deg, tilt_deg);
    EXPECT_TRUE(set.TruthPose().isApprox(rig.ptu->TWorldColor(pan_deg, tilt_deg)));
    const RigidTransform T_world_depth = set.TruthPose() * rig.T_color_depth;
    cv::Mat1w range, amplitude;
    set.RenderTof(0, range, amplitude);
    int smooth = 0;
    int off = 0;
    for (int v = 2; v < range.rows; v += 4) {
      for (int u = 2; u < range.cols; u += 4) {
        auto true_m = [&](double x, double y) {
          const Vector2d n = camera.camera.Unproject({x, y}).value();
          const Vector3d d = T_world_depth.linear() * Vector3d(n.x(), n.y(), 1).normalized();
          return set.Trace({T_world_depth.translation(), d}, 0).range_m;
        };
        const double range_m = true_m(u, v);
        if (std::abs(true_m(u - 1, v) + true_m(u + 1, v) - 2 * range_m) > 0.01 ||
            std::abs(true_m(u, v - 1) + true_m(u, v + 1) - 2 * range_m) > 0.01) {
          continue;
        }
        ++smooth;
        const double expected_m = range_m + camera.range_error.At(range_m);
        off += std::abs(range(v, u) * camera.unit_m - expected_m) > 0.006 ? 1 : 0;
      }
    }
    EXPECT_GT(smooth, 800);
    EXPECT_LE(off, smooth / 50) << pan_deg;
  }
}

TEST(TofView, SeesABoardsSquaresInItsAmplitudeAndItsPlaneInItsRange) {
  SyntheticScene& set = HalfSet();
  set.Arrange(0, 0);
  const DepthCamera& camera = *set.rig().depth;
  const RigidTransform T_world_depth = set.TruthPose() * set.rig().T_color_depth;
  const StandingBoard board = BoardAt(T_world_depth, {-0.3, -0.2, 1.2}, -0.3);
  set.Arrange(0, 0, {board});
  cv::Mat1w range, amplitude;
  set.RenderTof(0, range, amplitude);
  for (int j = 0; j < board.board.rows - 1; ++j) {
    for (int i = 0; i < board.board.columns - 1; ++i) {
      auto pixel = [&](int column, int row) {  // the middle of a square
        const Vector3d p = T_world_depth.inverse() * board.T_world_board *
                           Vector3d(0.08 * (column + 0.5), 0.08 * (row + 0.5), 0);
        const Vector2d q = camera.camera.Project(p).value();
        return cv::Point(static_cast<int>(std::lround(q.x())), static_cast<int>(std::lround(q.y())));
      };
      // The square beyond the first corner, towards the second, is white: (0, 0) counts from there.
      const bool black = (i + j) % 2 == 0;
      const double here = amplitude(pixel(i, j));
      const double right = amplitude(pixel(i + 1, j));
      EXPECT_TRUE(black ? here < 0.6 * right : right < 0.6 * here) << i << ", " << j;
      const cv::Point at = pixel(i, j);
      const Vector2d n = camera.camera.Unproject(Vector2d(at.x, at.y)).value();
      const Vector3d d = T_world_depth.linear() * Vector3d(n.x(), n.y(), 1).normalized();
      const auto met = board.Meet({T_world_depth.translation(), d});
      ASSERT_TRUE(met.has_value());
      EXPECT_NEAR(range(at) * camera.unit_m, met->range_m + camera.range_error.At(met->range_m), 0.002);
    }
  }
}

TEST(SyntheticScene, BackAtRestTheHeadSeesTheSamePictures) {
  SyntheticScene& set = HalfSet();
  set.Arrange(0, 0);
  YuvImage before, after;
  set.RenderColor(0, before);
  set.Arrange(12, 3, {BoardAt(set.TruthPose(), {-0.3, -0.2, 1.5}, 0.1)});
  set.RenderColor(0, after);
  EXPECT_GT(cv::norm(before.y, after.y, cv::NORM_L1), 1e5);
  set.Arrange(0, 0);
  set.RenderColor(0, after);
  EXPECT_EQ(cv::norm(before.y, after.y, cv::NORM_INF), 0);
}

// Furniture or walls before a board would make a bad recording.
TEST(SyntheticViews, NothingStandsBeforeABoardAndEveryViewSeesOne) {
  Rig rig = SmallRig();
  auto set = SyntheticScene::Create(rig, {.figure = false});
  ASSERT_TRUE(set.has_value());
  int whole_in_color = 0;
  for (const SyntheticViews kind : {SyntheticViews::kCalibration, SyntheticViews::kHandEye}) {
    for (const SyntheticView& view : ViewsOf(kind, rig)) {
      set->Arrange(view.pan_deg, view.tilt_deg, view.boards);
      const RigidTransform T_world_color = set->TruthPose();
      const RigidTransform T_world_fisheye = T_world_color * rig.T_color_fisheye;
      const bool wide = view.recorded_by == RecordedBy::kFisheye;
      int seen = 0;
      for (const StandingBoard& board : view.boards) {
        int in_color = 0, in_fisheye = 0;
        for (const int i : {0, board.board.columns - 1}) {
          for (const int j : {0, board.board.rows - 1}) {
            const Vector3d p = board.T_world_board * Vector3d(0.08 * i, 0.08 * j, 0);
            const Vector3d from =
                wide ? Vector3d(T_world_fisheye.translation()) : Vector3d(T_world_color.translation());
            const Hit hit = set->Trace({from, (p - from).normalized()}, 0);
            EXPECT_NEAR(hit.range_m, (p - from).norm(), 1e-6);
            const auto c = rig.color.Project(T_world_color.inverse() * p);
            in_color += c && c->x() > 1 && c->x() < rig.color.width - 2 && c->y() > 1 &&
                        c->y() < rig.color.height - 2;
            in_fisheye += rig.fisheye->Project(T_world_fisheye.inverse() * p).has_value();
          }
        }
        whole_in_color += in_color == 4;
        seen += wide ? in_fisheye == 4 : in_color >= 3;
      }
      EXPECT_GE(seen, 1);
    }
  }
  EXPECT_GE(whole_in_color, 28);
}

}  // namespace
}  // namespace mixstage
