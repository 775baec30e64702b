// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/joint_adjustment.h"

#include <gtest/gtest.h>

#include "server/calibration/board_order.h"
#include "server/calibration/lens_start.h"
#include "server/calibration/scene_start.h"
#include "tests/support/board_views.h"

namespace mixstage {
namespace {

// Forgets all that a calibration has to find.
BoardScene Blank(const BoardScene& truth) {
  BoardScene scene = truth;
  for (SceneCamera& c : scene.cameras) {
    const Lens old = c.lens;
    c.lens = AssumedLens(old.kind, old.width, old.height);
    c.T_first_camera.reset();
  }
  for (Placement& p : scene.placements) p.T_first_board.reset();
  return scene;
}

void Start(BoardScene& scene) {
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    std::vector<BoardSighting> sightings;
    for (const SceneSighting& s : scene.sightings) {
      if (s.camera == c) sightings.push_back(s.corners);
    }
    const auto start = StartLens(scene.cameras[c].lens, scene.boards, sightings);
    ASSERT_TRUE(start) << start.error().message;
    scene.cameras[c].lens = start->lens;
  }
  EXPECT_TRUE(StartPoses(scene).empty());
}

// Largest distance, px, between what two scenes' cameras see of the true boards in the true pictures.
double LargestDifference(const BoardScene& truth, const BoardScene& found, std::size_t camera) {
  double largest = 0;
  for (const SceneSighting& s : truth.sightings) {
    if (s.camera != camera) continue;
    const RigidTransform T_found = found.TCameraBoard(camera, s.placement);
    const RigidTransform T_true = truth.TCameraBoard(camera, s.placement);
    const Board& board = truth.boards[truth.placements[s.placement].board];
    for (int i : s.corners.corners) {
      const auto a = truth.cameras[camera].lens.Project(T_true * board.Corner(i));
      const auto b = found.cameras[camera].lens.Project(T_found * board.Corner(i));
      largest = std::max(largest, a && b ? (*a - *b).norm() : 1e9);
    }
  }
  return largest;
}

TEST(JointAdjustment, FindsThreeCamerasFromNothingIncludingAFisheyeBeyond90Degrees) {
  BoardScene truth = TrueRigWithoutViews();
  AddTrueViews(truth, 0, 16, 12, 0, 1);
  BoardScene scene = Blank(truth);
  Start(scene);
  ASSERT_TRUE(AdjustRobustly(scene));
  for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(LargestDifference(truth, scene, c), 1e-3) << c;
  EXPECT_NEAR(scene.cameras[1].lens.numbers[0], 220.6, 1e-2);
  EXPECT_LT((scene.cameras[2].T_first_camera->translation() - truth.cameras[2].T_first_camera->translation())
                .norm(),
            1e-5);
}

TEST(JointAdjustment, CamerasAgreeWhichWayABoardHangsThatLooksTheSameUpsideDown) {
  BoardScene truth = TrueRigWithoutViews();
  AddTrueViews(truth, 1, 14, 10, 0.05, 2);
  BoardScene scene = Blank(truth);
  for (std::size_t i = 0; i < scene.sightings.size(); i += 3)
    TurnUpsideDown(scene.sightings[i].corners.pixels);
  Start(scene);
  ASSERT_TRUE(AdjustRobustly(scene));
  for (const SceneSighting& s : scene.sightings) {
    EXPECT_TRUE(s.left_out.empty()) << s.left_out;
    EXPECT_LT(s.rms_px, 0.15);
  }
  EXPECT_NEAR(scene.cameras[0].corner_sigma_px, 0.05, 0.01);
}

TEST(JointAdjustment, ASightingThatContradictsTheOthersIsLeftOutByName) {
  BoardScene truth = TrueRigWithoutViews();
  AddTrueViews(truth, 0, 16, 8, 0.05, 3);
  BoardScene scene = Blank(truth);
  SceneSighting& bad = scene.sightings[4];
  for (Eigen::Vector2d& p : bad.corners.pixels) p += Eigen::Vector2d(6, -4);  // the board was carried on
  Start(scene);
  ASSERT_TRUE(AdjustRobustly(scene));
  int left_out = 0;
  for (const SceneSighting& s : scene.sightings) left_out += s.left_out.empty() ? 0 : 1;
  EXPECT_EQ(left_out, 1);
  EXPECT_NE(scene.sightings[4].left_out.find("px rms"), std::string::npos);
}

TEST(JointAdjustment, AHeldOutViewTeachesNothingAndIsStillMeasured) {
  BoardScene truth = TrueRigWithoutViews();
  AddTrueViews(truth, 0, 16, 8, 0.05, 4);
  BoardScene scene = Blank(truth);
  Start(scene);
  scene.placements[2].held_out = true;
  BoardScene without = scene;
  for (SceneSighting& s : without.sightings) {
    if (s.placement == 2) s.left_out = "not there";
  }
  ASSERT_TRUE(AdjustRobustly(scene));
  ASSERT_TRUE(AdjustRobustly(without));
  EXPECT_NEAR(scene.cameras[0].lens.numbers[0], without.cameras[0].lens.numbers[0], 1e-3);
  for (const SceneSighting& s : scene.sightings) {
    if (s.placement == 2) {
      EXPECT_LT(s.rms_px, 0.15);
    }
  }
}

TEST(LensStart, TooFewBoardsAreRefused) {
  BoardScene truth = TrueRigWithoutViews();
  AddTrueViews(truth, 0, 2, 0, 0, 5);
  for (std::size_t c : {std::size_t{0}, std::size_t{2}}) {
    const auto start = StartLens(truth.cameras[c].lens, truth.boards, {truth.sightings[0].corners});
    ASSERT_FALSE(start);
    EXPECT_EQ(start.error().code, ErrorCode::kQualityGate);
  }
}

}  // namespace
}  // namespace mixstage
