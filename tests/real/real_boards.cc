// SPDX-License-Identifier: Apache-2.0
//
// Boards seen by real cameras (../shared/data/real, not part of the repository): the layouts that others left
// behind, read here and given to the same library. Figures to reach are OpenCV's, of data/real/README.md.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <sstream>

#include "server/calibration/board_detection.h"
#include "server/calibration/board_pose.h"
#include "server/calibration/hand_eye.h"
#include "server/calibration/joint_adjustment.h"
#include "server/calibration/lens_start.h"
#include "server/calibration/scene_start.h"
#include "server/calibration/tsai.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;

constexpr double kNoWorse = 1.02;

fs::path Real(const std::string& set) { return fs::path(MIXSTAGE_SOURCE_DIR) / "../shared/data/real" / set; }

#define SKIP_WITHOUT(set) \
  if (!fs::exists(Real(set))) GTEST_SKIP() << Real(set) << " is not there"

Board Checkerboard(int columns, int rows, double square_m) {
  Board board;
  board.name = "board";
  board.columns = columns;
  board.rows = rows;
  board.square_m = square_m;
  return board;
}

// What is free beside focal lengths and principal point.
Lens Pinhole(int width, int height, const std::vector<int>& free) {
  Lens lens = AssumedLens(LensKind::kPinhole, width, height);
  lens.free = {0, 1, 2, 3};
  lens.free.insert(lens.free.end(), free.begin(), free.end());
  return lens;
}

const std::vector<int> kTwoRadial{4, 5}, kFive{4, 5, 6, 7, 8};

// Cameras that look at one board, picture by picture.
struct Set {
  BoardScene scene;
  std::vector<std::vector<BoardSighting>> seen;  // by camera

  explicit Set(const Board& board) { scene.boards = {board}; }

  std::size_t AddCamera(const std::string& name, const Lens& lens) {
    SceneCamera camera;
    camera.name = name;
    camera.lens = lens;
    scene.cameras.push_back(camera);
    seen.emplace_back();
    return scene.cameras.size() - 1;
  }

  // Views of the same name are one placement of the board.
  void Add(std::size_t camera, const std::string& view, BoardSighting sighting) {
    auto place = std::find_if(scene.placements.begin(), scene.placements.end(),
                              [&](const Placement& p) { return p.view == view; });
    if (place == scene.placements.end()) {
      Placement placement;
      placement.view = view;
      scene.placements.push_back(placement);
      place = scene.placements.end() - 1;
    }
    SceneSighting s;
    s.camera = camera;
    s.placement = static_cast<std::size_t>(place - scene.placements.begin());
    s.corners = sighting;
    s.file = view + " of " + scene.cameras[camera].name;
    scene.sightings.push_back(s);
    seen[camera].push_back(std::move(sighting));
  }

  // True when the picture shows the board.
  bool Search(std::size_t camera, const std::string& view, const fs::path& file, int enlarge = 1) {
    const cv::Mat picture = cv::imread(file.string(), cv::IMREAD_ANYDEPTH | cv::IMREAD_GRAYSCALE);
    if (picture.empty()) return false;
    Lens& lens = scene.cameras[camera].lens;
    const cv::Mat1b grey = ForDetection(picture);
    const auto found = lens.kind == LensKind::kFisheye
                           ? FindBoardsInFisheye(grey, scene.boards, FisheyeOf(lens))
                           : FindBoards(grey, scene.boards, enlarge);
    if (found.empty()) return false;
    Add(camera, view, found[0]);
    return true;
  }

  void Calibrate() {
    for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
      const auto start = StartLens(scene.cameras[c].lens, scene.boards, seen[c]);
      ASSERT_TRUE(start) << scene.cameras[c].name << ": " << start.error().message;
      scene.cameras[c].lens = start->lens;
      UseCorners(scene, c, start->corners);
    }
    const auto alone = StartPoses(scene);
    ASSERT_TRUE(alone.empty());
    const auto done = AdjustRobustly(scene);
    ASSERT_TRUE(done) << done.error().message;
    // OpenCV's figures are those of plain least squares, all cameras' pixels alike.
    for (SceneCamera& camera : scene.cameras) camera.corner_sigma_px = 1;
    const auto plain = AdjustJointly(scene);
    ASSERT_TRUE(plain) << plain.error().message;
    for (SceneSighting& s : scene.sightings) {
      if (!scene.Used(s)) continue;
      double sum = 0;
      const auto residuals = CornerResiduals(scene, s);
      for (const Eigen::Vector2d& r : residuals) sum += r.squaredNorm();
      s.rms_px = std::sqrt(sum / static_cast<double>(residuals.size()));
    }
    for (std::size_t c = 0; c < scene.cameras.size(); ++c)
      std::printf("  %-8s rms %.3f px, f %.2f / %.2f, %d views left out\n", scene.cameras[c].name.c_str(),
                  Rms(c), scene.cameras[c].lens.numbers[0], scene.cameras[c].lens.numbers[1], LeftOut(c));
    for (std::size_t c = 1; c < scene.cameras.size(); ++c) {
      const Eigen::Vector3d t = scene.cameras[c].T_first_camera->inverse().translation();
      std::printf("  %-8s from the first: %.4f %.4f %.4f\n", scene.cameras[c].name.c_str(), t.x(), t.y(),
                  t.z());
    }
  }

  // Of the corners that took part, as OpenCV counts: distances, not coordinates. All cameras: -1.
  [[nodiscard]] double Rms(std::optional<std::size_t> camera = std::nullopt) const {
    double sum = 0, n = 0;
    for (const SceneSighting& s : scene.sightings) {
      if (!scene.Used(s) || (camera && s.camera != *camera)) continue;
      const auto count = static_cast<double>(s.corners.corners.size());
      sum += s.rms_px * s.rms_px * count;
      n += count;
    }
    return std::sqrt(sum / n);
  }

  [[nodiscard]] int LeftOut(std::size_t camera) const {
    return static_cast<int>(std::count_if(scene.sightings.begin(), scene.sightings.end(), [&](const auto& s) {
      return s.camera == camera && !scene.Used(s);
    }));
  }

  // A camera by itself, as cv::calibrateCamera takes it.
  [[nodiscard]] Set Alone(std::size_t camera) const {
    Set one(scene.boards[0]);
    one.AddCamera(scene.cameras[camera].name, scene.cameras[camera].lens);
    for (const SceneSighting& s : scene.sightings)
      if (s.camera == camera) one.Add(0, scene.placements[s.placement].view, s.corners);
    return one;
  }
};

TEST(RealBoards, StereoPairIsNoWorseThanOpenCv) {
  SKIP_WITHOUT("calib_stereo");
  Set set(Checkerboard(9, 6, 1));
  for (const char* side : {"left", "right"}) {
    const std::size_t camera = set.AddCamera(side, Pinhole(640, 480, kFive));
    for (const char* n : {"01", "02", "03", "04", "05", "06", "07", "08", "09", "11", "12", "13", "14"})
      EXPECT_TRUE(set.Search(camera, n, Real("calib_stereo") / (std::string(side) + n + ".jpg")))
          << side << n;
  }
  Set left = set.Alone(0), right = set.Alone(1);
  left.Calibrate();
  right.Calibrate();
  EXPECT_LE(left.Rms(), kNoWorse * 0.195);
  EXPECT_LE(right.Rms(), kNoWorse * 0.207);
  set.Calibrate();
  EXPECT_LE(set.Rms(), kNoWorse * 0.215);
  EXPECT_EQ(set.LeftOut(0) + set.LeftOut(1), 0);
  const Eigen::Vector3d t = set.scene.cameras[1].T_first_camera->inverse().translation();
  EXPECT_LT((t - Eigen::Vector3d(-3.328, 0.037, 0.014)).norm(), 0.05);
}

// Every view by itself through Tsai's method, beside all views through the adjustment: f within what a single
// plane tells of it.
TEST(RealBoards, TsaiAgreesWithAllViewsTogether) {
  SKIP_WITHOUT("calib_stereo");
  Set set(Checkerboard(9, 6, 1));
  set.AddCamera("left", Pinhole(640, 480, {4}));
  for (const char* n : {"01", "02", "03", "04", "05", "06", "07", "08", "09", "11", "12", "13", "14"})
    ASSERT_TRUE(set.Search(0, n, Real("calib_stereo") / (std::string("left") + n + ".jpg")));
  set.Calibrate();
  const double f = set.scene.cameras[0].lens.numbers[1];
  const Eigen::Vector2d centre(set.scene.cameras[0].lens.numbers[2], set.scene.cameras[0].lens.numbers[3]);
  double chi2 = 0;
  int n = 0, refused = 0;
  for (const SceneSighting& s : set.scene.sightings) {
    std::vector<PointInPicture> points;
    for (std::size_t i = 0; i < s.corners.corners.size(); ++i)
      points.push_back({set.scene.boards[0].Corner(s.corners.corners[i]), s.corners.pixels[i]});
    const auto tsai = CalibrateTsai(points, 640, 480, centre);
    if (!tsai) {
      std::printf("  %s: %s\n", s.file.c_str(), tsai.error().message.c_str());
      ++refused;
      continue;
    }
    std::printf("  %s: f %.1f +- %.1f (all %.1f), k1 %.3f, rms %.3f (all %.3f) px, %zu held\n",
                s.file.c_str(), tsai->camera.fy, tsai->f_sd_px, f, tsai->camera.k1, tsai->rms_px, s.rms_px,
                tsai->held.size());
    EXPECT_LE(tsai->rms_px, s.rms_px) << s.file;
    chi2 += std::pow((tsai->camera.fy - f) / tsai->f_sd_px, 2);
    ++n;
  }
  EXPECT_LE(refused, 4);
  EXPECT_LT(std::sqrt(chi2 / n), 4);
}

TEST(RealBoards, FisheyeBeyond180DegreesIsNoWorseThanOpenCv) {
  SKIP_WITHOUT("calib_fisheye");
  Set set(Checkerboard(6, 8, 0.0325));
  Lens lens = AssumedLens(LensKind::kFisheye, 1032, 778);
  set.AddCamera("fisheye", lens);
  for (int n = 1; n <= 15; ++n) {
    const std::string name = "Fisheye1_" + std::to_string(n);
    EXPECT_TRUE(set.Search(0, name, Real("calib_fisheye/fisheye1_over180") / (name + ".jpg"))) << name;
  }
  set.Calibrate();
  EXPECT_LE(set.Rms(), kNoWorse * 0.637);
}

TEST(RealBoards, FisheyePairIsNoWorseThanOpenCv) {
  SKIP_WITHOUT("calib_fisheye");
  Set set(Checkerboard(9, 6, 0.02423));
  for (const char* side : {"left", "right"}) {
    const std::size_t camera = set.AddCamera(side, AssumedLens(LensKind::kFisheye, 960, 600));
    for (const char* n : {"01", "04", "07", "10", "13", "16", "19", "22"})
      EXPECT_TRUE(
          set.Search(camera, n, Real("calib_fisheye/stereo_fisheye") / (std::string(side) + n + ".jpg")))
          << side << n;
  }
  Set left = set.Alone(0), right = set.Alone(1);
  left.Calibrate();
  right.Calibrate();
  EXPECT_LE(left.Rms(), kNoWorse * 0.169);
  EXPECT_LE(right.Rms(), kNoWorse * 0.173);
  set.Calibrate();
  EXPECT_LE(set.Rms(), kNoWorse * 0.490);
  EXPECT_NEAR(set.scene.cameras[1].T_first_camera->translation().norm(), 0.110, 0.002);
}

TEST(RealBoards, InfraredAndTwoColourCamerasAreNoWorseThanOpenCv) {
  SKIP_WITHOUT("calib_tof_ir");
  Set set(Checkerboard(10, 7, 0.0215));
  const struct {
    const char* name;
    const char* end;
    int width, height, enlarge;
  } cameras[] = {
      {"ir", ".png", 512, 424, 4}, {"colour1", ".jpg", 1920, 1080, 1}, {"colour2", ".jpg", 1920, 1080, 1}};
  for (const auto& one : cameras) {
    const std::size_t camera = set.AddCamera(one.name, Pinhole(one.width, one.height, kTwoRadial));
    int found = 0;
    for (int n = 0; n < 7; ++n)
      found += set.Search(camera, std::to_string(n),
                          Real("calib_tof_ir/kinect2_two_colour") /
                              (std::string(one.name) + "_" + std::to_string(n) + one.end),
                          one.enlarge);
    std::printf("  %s: %d of 7 views\n", one.name, found);
    EXPECT_GE(found, 4);
  }
  const double figures[] = {0.075, 0.285, 0.346};
  for (std::size_t c = 0; c < 3; ++c) {
    Set alone = set.Alone(c);
    alone.Calibrate();
    EXPECT_LE(alone.Rms(), kNoWorse * figures[c]) << set.scene.cameras[c].name;
  }
  set.Calibrate();
}

nlohmann::json Corners(const std::string& set) {
  return nlohmann::json::parse(std::ifstream(Real(set) / "corners.json"));
}

BoardSighting SightingOf(const nlohmann::json& pixels) {
  BoardSighting sighting;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    sighting.corners.push_back(static_cast<int>(i));
    sighting.pixels.emplace_back(pixels[i][0].get<double>(), pixels[i][1].get<double>());
  }
  sighting.square_px = (sighting.pixels[1] - sighting.pixels[0]).norm();
  return sighting;
}

// The board hangs nearly parallel to the sensor in every view: no lens may come out of it.
TEST(RealBoards, AFocalLengthThatTheViewsDoNotDetermineIsRefused) {
  SKIP_WITHOUT("calib_tof_ir");
  const auto json = Corners("calib_tof_ir/tof100");
  Set set(Checkerboard(5, 4, 0.04));
  set.AddCamera("tof", Pinhole(101, 100, kTwoRadial));
  for (const auto& view : json["views"])
    set.Add(0, std::to_string(view["view"].get<int>()), SightingOf(view["tof_px_rotated"]));
  const auto start = StartLens(set.scene.cameras[0].lens, set.scene.boards, set.seen[0]);
  if (!start) {
    std::printf("  %s\n", start.error().message.c_str());
    EXPECT_EQ(start.error().code, ErrorCode::kQualityGate);
    return;
  }
  set.scene.cameras[0].lens = start->lens;
  StartPoses(set.scene);
  ASSERT_TRUE(AdjustRobustly(set.scene));
  const auto deviations = DeviationsByCorners(set.scene);
  if (!deviations) {
    std::printf("  %s\n", deviations.error().message.c_str());
    EXPECT_EQ(deviations.error().code, ErrorCode::kQualityGate);
    return;
  }
  const double f = set.scene.cameras[0].lens.numbers[0], sd = (*deviations)[0]->lens[0];
  std::printf("  f %.1f +- %.1f px\n", f, sd);
  EXPECT_GT(sd / f, 0.01);  // calibration_gates.cc refuses it
}

TEST(RealBoards, ViewsWhoseCornersDoNotCorrespondAreLeftOut) {
  SKIP_WITHOUT("calib_tof_ir");
  const auto json = Corners("calib_tof_ir/kinect2_ir_corners");
  // The list's first points run along x with y falling: columns along x, rows downwards.
  const auto& object = json["views"][0]["object_mm"];
  int columns = 1;
  while (object[static_cast<std::size_t>(columns)][1] == object[0][1]) ++columns;
  Set set(Checkerboard(columns, 35 / columns, 0.04));
  set.AddCamera("ir", Pinhole(512, 424, kTwoRadial));
  set.AddCamera("colour", Pinhole(1920, 1080, kTwoRadial));
  for (const auto& view : json["views"]) {
    const std::string name = std::to_string(view["view"].get<int>());
    set.Add(0, name, SightingOf(view["ir_px"]));
    set.Add(1, name, SightingOf(view["colour_px"]));
  }
  set.Calibrate();
  for (const SceneSighting& s : set.scene.sightings) {
    const std::string& view = set.scene.placements[s.placement].view;
    if (!s.left_out.empty()) std::printf("  %s: %s\n", s.file.c_str(), s.left_out.c_str());
    if (view != "4" && view != "7") {
      EXPECT_TRUE(s.left_out.empty()) << view;
    }
  }
  EXPECT_GE(set.LeftOut(0) + set.LeftOut(1), 2);
  EXPECT_LE(set.Rms(), kNoWorse * 0.359);
  EXPECT_NEAR(set.scene.cameras[1].T_first_camera->inverse().translation().x(), -0.0525, 0.001);
}

TEST(RealBoards, HandEyeOfARobotScattersNoMoreThanOpenCv) {
  SKIP_WITHOUT("calib_handeye");
  Set set(Checkerboard(8, 7, 0.04));
  set.AddCamera("hand", Pinhole(640, 480, kFive));
  std::ifstream csv(Real("calib_handeye") / "robot_poses.csv");
  std::string line;
  std::getline(csv, line);
  RobotHandEyeInput input;
  input.boards = set.scene.boards;
  while (std::getline(csv, line)) {
    std::istringstream fields(line);
    std::string file, number;
    std::getline(fields, file, ',');
    std::vector<double> n;
    while (std::getline(fields, number, ',')) n.push_back(std::stod(number));
    ASSERT_EQ(n.size(), 6u);
    RobotView view;
    view.name = fs::path(file).stem().string();
    const Eigen::Vector3d turn(n[3], n[4], n[5]);
    view.T_base_hand.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    view.T_base_hand.translation() << n[0], n[1], n[2];
    EXPECT_TRUE(set.Search(0, view.name, Real("calib_handeye") / file)) << file;
    view.sightings = {set.seen[0].back()};
    input.views.push_back(view);
  }
  set.Calibrate();
  EXPECT_LE(set.Rms(), kNoWorse * 0.171);
  input.camera = PinholeOf(set.scene.cameras[0].lens);
  const auto found = CalibrateRobotHandEye(input);
  ASSERT_TRUE(found) << found.error().message;
  // Where each view puts the board in the robot's base, as the README's figure counts.
  std::vector<RigidTransform> boards;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (std::size_t v = 0; v < input.views.size(); ++v) {
    const auto T = PoseOfBoard(set.scene.cameras[0].lens, input.boards[0], input.views[v].sightings[0]);
    ASSERT_TRUE(T);
    boards.push_back(input.views[v].T_base_hand * found->T_hand_color * *T);
    mean += boards.back().translation() / static_cast<double>(input.views.size());
  }
  double scatter = 0, worst = 0;
  for (const auto& T : boards) {
    scatter += (T.translation() - mean).squaredNorm() / static_cast<double>(boards.size());
    worst = std::max(worst, (T.translation() - mean).norm());
  }
  const Eigen::Vector3d t = 1000 * found->T_hand_color.translation();
  std::printf(
      "  hand %.1f %.1f %.1f mm; board scatters %.3f mm rms, %.3f worst; poses %.3f deg %.2f mm, corners "
      "%.3f px\n",
      t.x(), t.y(), t.z(), 1000 * std::sqrt(scatter), 1000 * worst, found->rotation_noise_deg,
      found->translation_noise_mm, found->noise_px);
  for (const auto& view : found->views)
    if (!view.reason.empty()) std::printf("  %s: %s\n", view.name.c_str(), view.reason.c_str());
  for (const auto& figure : found->figures)
    std::printf("  %s %.2f +- %.2f %s\n", figure.name.c_str(), figure.value, figure.sd, figure.unit.c_str());
  for (const auto& words : found->weak) std::printf("  weak: %s\n", words.c_str());
  EXPECT_LE(1000 * std::sqrt(scatter), kNoWorse * 0.85);
}

}  // namespace
}  // namespace mixstage
