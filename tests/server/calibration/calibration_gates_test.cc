// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/calibration_gates.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "server/calibration/joint_adjustment.h"
#include "server/calibration/lens_start.h"
#include "server/calibration/scene_start.h"
#include "tests/support/board_picture.h"
#include "tests/support/board_views.h"

namespace mixstage {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;

RigCalibration Calibrate(BoardScene scene) {
  RigCalibration c;
  for (std::size_t i = 0; i < scene.cameras.size(); ++i) {
    std::vector<BoardSighting> sightings;
    for (const SceneSighting& s : scene.sightings) {
      if (s.camera == i) sightings.push_back(s.corners);
    }
    if (auto start = StartLens(scene.cameras[i].lens, scene.boards, sightings))
      scene.cameras[i].lens = start->lens;
  }
  StartPoses(scene);
  EXPECT_TRUE(AdjustRobustly(scene));
  if (auto deviations = DeviationsByCorners(scene)) {
    c.deviations = *deviations;
  } else {
    c.failed_gates.push_back(deviations.error().message);
  }
  c.figures.resize(scene.cameras.size());
  for (const SceneSighting& s : scene.sightings) c.figures[s.camera].boards += s.left_out.empty() ? 1 : 0;
  c.scene = std::move(scene);
  JudgeCalibration(c);
  return c;
}

TEST(CalibrationGates, VariedViewsPass) {
  BoardScene scene = TrueRigWithoutViews();
  AddTrueViews(scene, 0, 16, 12, 0.1, 1);
  EXPECT_THAT(Calibrate(scene).failed_gates, IsEmpty());
}

TEST(CalibrationGates, FrontalBoardsDoNotShowTheFocalLength) {
  BoardScene scene = TrueRigWithoutViews();
  scene.cameras.resize(1);
  for (int i = 0; i < 12; ++i) {
    const RigidTransform T =
        BoardAt(scene.boards[0], 1.2 + 0.1 * i, 0.5 * (i % 3), -0.5 * (i % 2), 3 * i, 0.01 * i);
    BoardScene one = scene;
    one.placements.push_back({"view", 0, 0, T, false});
    BoardSighting s;
    for (int k = 0; k < scene.boards[0].corners(); ++k) {
      s.corners.push_back(k);
      const double wobble = 0.1 * ((k * 37 + i * 11) % 7 - 3) / 3;  // px
      s.pixels.push_back(*scene.cameras[0].lens.Project(T * scene.boards[0].Corner(k)) +
                         Eigen::Vector2d(wobble, -wobble));
    }
    scene.placements.push_back({"view", static_cast<std::size_t>(i), 0, std::nullopt, false});
    scene.sightings.push_back({0, scene.placements.size() - 1, s, "", "", 0});
  }
  EXPECT_THAT(Calibrate(scene).failed_gates, Contains(HasSubstr("focal length is not observable")));
}

TEST(CalibrationGates, FourBoardsAreTooFew) {
  BoardScene scene = TrueRigWithoutViews();
  scene.cameras.resize(1);
  AddTrueViews(scene, 0, 4, 0, 0.1, 1);
  EXPECT_THAT(Calibrate(scene).failed_gates, Contains(HasSubstr("too few views")));
}

TEST(CalibrationGates, ACameraWithoutAnySharedBoardIsNamed) {
  BoardScene scene = TrueRigWithoutViews();
  AddTrueViews(scene, 0, 10, 10, 0.1, 1);
  std::erase_if(scene.sightings, [&](const SceneSighting& s) { return s.camera == 2 && s.placement < 10; });
  EXPECT_THAT(Calibrate(scene).failed_gates, Contains(HasSubstr("fisheye: shares no view")));
}

TEST(CalibrationGates, TheFrontalViewsOfARealToFCameraAreRefused) {
  const std::filesystem::path file =
      MIXSTAGE_SOURCE_DIR "/../shared/data/real/calib_tof_ir/tof100/corners.json";
  if (!std::filesystem::exists(file)) GTEST_SKIP() << "shared test data is not there: " << file;
  std::ifstream in(file);
  const auto json = nlohmann::json::parse(in);
  BoardScene scene;
  scene.boards = {{"tof100", json["board_inner_corners"][0], json["board_inner_corners"][1], 0.04, 0}};
  // Corners are labelled in the picture turned by a quarter: 101 x 100.
  scene.cameras.push_back({"depth", AssumedLens(LensKind::kPinhole, 101, 100), std::nullopt, 0.1});
  for (const auto& view : json["views"]) {
    BoardSighting s;
    for (const auto& p : view["tof_px_rotated"]) {
      s.corners.push_back(static_cast<int>(s.pixels.size()));
      s.pixels.emplace_back(p[0].get<double>(), p[1].get<double>());
    }
    s.square_px = 6;
    scene.placements.push_back({"view", scene.placements.size(), 0, std::nullopt, false});
    scene.sightings.push_back({0, scene.placements.size() - 1, s, "", "", 0});
  }
  EXPECT_FALSE(Calibrate(scene).failed_gates.empty());
}

}  // namespace
}  // namespace mixstage
