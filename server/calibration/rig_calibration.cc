// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/rig_calibration.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "proto/take/picture_files.h"
#include "server/calibration/calibration_gates.h"
#include "server/calibration/hand_eye_views.h"
#include "server/calibration/joint_adjustment.h"
#include "server/calibration/lens_start.h"
#include "server/calibration/opencv_figures.h"
#include "server/calibration/picture_light.h"
#include "server/calibration/pixel_adjustment.h"
#include "server/calibration/scene_start.h"

namespace mixstage {
namespace {

constexpr double kDegPerRad = 180 / std::numbers::pi;
constexpr std::size_t kHoldOutEvery = 5;

// Lenses of all cameras that boards suffice for; the others' sightings are left out.
void StartLenses(RigCalibration& c) {
  for (std::size_t i = 0; i < c.scene.cameras.size(); ++i) {
    SceneCamera& camera = c.scene.cameras[i];
    std::vector<BoardSighting> sightings;
    for (const SceneSighting& s : c.scene.sightings) {
      if (s.camera == i && s.left_out.empty()) sightings.push_back(s.corners);
    }
    auto start = StartLens(camera.lens, c.scene.boards, sightings);
    if (start) {
      camera.lens = start->lens;
      UseCorners(c.scene, i, start->corners);
      continue;
    }
    c.warnings.push_back(camera.name + ": " + start.error().message);
    for (SceneSighting& s : c.scene.sightings) {
      if (s.camera == i && s.left_out.empty()) s.left_out = "its camera has no start";
    }
  }
}

double Percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

void MeasureCamera(const BoardScene& scene, std::size_t camera, CameraFigures& f) {
  const Lens& lens = scene.cameras[camera].lens;
  std::vector<double> distances;
  std::vector<double> tilts;
  std::vector<double> angles;
  std::set<int> fields;
  double squares = 0;
  for (const SceneSighting& s : scene.sightings) {
    if (s.camera != camera || !s.left_out.empty()) continue;
    ++f.boards;
    if (!scene.Used(s)) continue;
    squares += s.rms_px * s.rms_px;
    const Board& board = scene.boards[scene.placements[s.placement].board];
    const RigidTransform T = scene.TCameraBoard(camera, s.placement);
    const Eigen::Vector3d middle = T * Eigen::Vector3d(0.5 * board.Corner(board.corners() - 1));
    distances.push_back(middle.norm());
    tilts.push_back(std::acos(std::clamp(std::abs(T.linear().col(2).dot(middle.normalized())), 0.0, 1.0)) *
                    kDegPerRad);
    for (std::size_t i = 0; i < s.corners.corners.size(); ++i) {
      const Eigen::Vector3d p = T * board.Corner(s.corners.corners[i]);
      angles.push_back(std::atan2(p.head<2>().norm(), p.z()) * kDegPerRad);
      const auto column = static_cast<int>(8 * (s.corners.pixels[i].x() + 0.5) / lens.width);
      const auto row = static_cast<int>(6 * (s.corners.pixels[i].y() + 0.5) / lens.height);
      fields.insert(std::clamp(row, 0, 5) * 8 + std::clamp(column, 0, 7));
    }
  }
  if (distances.empty()) return;
  f.rms_px = std::sqrt(squares / static_cast<double>(distances.size()));
  f.nearest_m = *std::min_element(distances.begin(), distances.end());
  f.farthest_m = *std::max_element(distances.begin(), distances.end());
  f.most_tilted_deg = Percentile(tilts, 0.95);
  f.seen_to_deg = Percentile(angles, 0.99);
  f.covered = static_cast<double>(fields.size()) / 48;
}

// Learns from four fifths of the views and measures the others.
Status HoldOut(const RigCalibration& c, const std::vector<FittedPicture>& pictures,
               std::vector<CameraFigures>& figures) {
  BoardScene scene = c.scene;
  for (Placement& p : scene.placements) p.held_out = p.view_index % kHoldOutEvery == kHoldOutEvery - 1;
  if (auto ok = pictures.empty() ? AdjustJointly(scene) : AdjustToPixels(pictures, scene, 10); !ok)
    return tl::unexpected(ok.error());
  std::vector<double> squares(scene.cameras.size());
  for (const SceneSighting& s : scene.sightings) {
    if (!scene.Used(s) || !scene.placements[s.placement].held_out) continue;
    double sum = 0;
    const auto residuals = CornerResiduals(scene, s);
    for (const Eigen::Vector2d& r : residuals) sum += r.squaredNorm();
    squares[s.camera] += sum / static_cast<double>(residuals.size());
    ++figures[s.camera].held_out_boards;
  }
  for (std::size_t i = 0; i < squares.size(); ++i) {
    if (figures[i].held_out_boards > 0)
      figures[i].held_out_rms_px = std::sqrt(squares[i] / figures[i].held_out_boards);
  }
  return {};
}

std::optional<cv::Mat1f> Brightness(const RigCalibration& c, std::size_t camera, std::size_t view_index) {
  const std::string& name = c.scene.cameras[camera].name;
  const auto& file = PictureOf(c.views[view_index], name);
  if (!file) return std::nullopt;
  const auto grey = LoadGrey(*file);
  const Lens& lens = c.scene.cameras[camera].lens;
  if (!grey || grey->cols != lens.width || grey->rows != lens.height) return std::nullopt;
  return name == kDepthName || grey->depth() != CV_8U ? CountsOfLight(*grey) : LinearLight(*grey);
}

double UsedRms(BoardScene& scene) {
  MeasureCorners(scene);
  double sum = 0;
  for (const SceneSighting& s : scene.sightings) {
    const double sigma = scene.cameras[s.camera].corner_sigma_px;
    if (scene.Used(s)) sum += s.rms_px * s.rms_px / (sigma * sigma);
  }
  return std::sqrt(sum);
}

// Pixels instead of corners. Corners have no part in it and judge the outcome: where they contradict it, the
// corners' own adjustment stands and no picture is returned.
Result<std::vector<FittedPicture>> RefineOnPixels(RigCalibration& c) {
  const BoardScene by_corners = c.scene;
  const double before = UsedRms(c.scene);
  std::vector<FittedPicture> pictures;
  for (int round = 0; round < 2; ++round) {  // the second with weights of the first one's residuals
    pictures = FitPictures(c.scene,
                           [&](std::size_t camera, std::size_t view) { return Brightness(c, camera, view); });
    if (pictures.empty()) return pictures;
    if (auto ok = AdjustToPixels(pictures, c.scene, 15); !ok) return tl::unexpected(ok.error());
  }
  if (UsedRms(c.scene) > 1.5 * before) {
    c.scene = by_corners;
    c.warnings.push_back("the pictures' pixels contradict their corners: calibrated on corners alone");
    return std::vector<FittedPicture>();
  }
  std::vector<std::vector<double>> spots(c.scene.cameras.size());
  for (const FittedPicture& p : pictures) {
    ++c.figures[p.camera].fitted_pictures;
    c.figures[p.camera].fitted_pixels += p.fit.pixels();
    spots[p.camera].push_back(p.fit.spot_px());
  }
  for (std::size_t i = 0; i < spots.size(); ++i) c.figures[i].spot_px = Percentile(spots[i], 0.5);
  return pictures;
}

void CalibrateRange(const NominalRig& nominal, std::size_t camera, RigCalibration& c) {
  RangePictureScale scale;
  if (nominal.given && nominal.rig.depth) {
    scale.unit_m = nominal.rig.depth->unit_m;
    scale.unambiguous_range_m = nominal.rig.depth->unambiguous_range_m;
    scale.measures_z = nominal.rig.depth->measures == DepthMeasure::kZ;
  }
  std::vector<RangeSample> samples;
  for (std::size_t p = 0; p < c.scene.placements.size(); ++p) {
    const Placement& placement = c.scene.placements[p];
    const BoardView& view = c.views[placement.view_index];
    if (!placement.T_first_board || !view.depth) continue;
    cv::Mat1w range;
    cv::Mat1w amplitude;
    if (auto ok = LoadDepth16(*view.depth, range); !ok) {
      c.notes.push_back({view.depth->string(), ok.error().message});
      continue;
    }
    if (view.amplitude) (void)LoadDepth16(*view.amplitude, amplitude);  // noted when it was searched
    const Lens& lens = c.scene.cameras[camera].lens;
    if (range.cols != lens.width || range.rows != lens.height) {
      c.notes.push_back({view.depth->string(), "is not of the amplitude pictures' size"});
      continue;
    }
    AppendRangeSamples(lens, c.scene.TCameraBoard(camera, p), c.scene.boards[placement.board], range,
                       amplitude, scale, placement.view_index, samples);
  }
  auto curve = FitRangeCurve(samples, scale.unambiguous_range_m);
  if (curve) {
    c.range = std::move(*curve);
  } else {
    c.warnings.push_back("depth: no range error curve: " + curve.error().message);
  }
}

void FillRig(const NominalRig& nominal, RigCalibration& c) {
  c.rig = nominal.rig;
  for (std::size_t i = 0; i < c.scene.cameras.size(); ++i) {
    const SceneCamera& camera = c.scene.cameras[i];
    if (!camera.T_first_camera) continue;
    // Without colour the first camera is another: poses relative to colour stay nominal.
    const bool relative_to_color = c.scene.cameras[0].name == kColorName;
    if (camera.name == kColorName) {
      c.rig.color = PinholeOf(camera.lens);
    } else if (camera.name == kDepthName) {
      if (!c.rig.depth) c.rig.depth.emplace();
      c.rig.depth->camera = PinholeOf(camera.lens);
      if (c.range) c.rig.depth->range_error = c.range->error;
      if (relative_to_color) c.rig.T_color_depth = *camera.T_first_camera;
    } else {
      c.rig.fisheye = FisheyeOf(camera.lens);
      if (relative_to_color) c.rig.T_color_fisheye = *camera.T_first_camera;
    }
  }
}

}  // namespace

Result<RigCalibration> CalibrateRig(const std::vector<ViewFolder>& folders, const NominalRig& nominal,
                                    const std::function<void(const std::string&)>& stage) {
  RigCalibration c;
  stage("searching the pictures for boards");
  auto detected = DetectViews(folders, nominal, [&](std::size_t done, std::size_t all) {
    if (done % 10 == 0 || done == all)
      stage("searched " + std::to_string(done) + " of " + std::to_string(all) + " pictures");
  });
  if (!detected) return tl::unexpected(detected.error());
  c.scene = std::move(detected->scene);
  c.views = std::move(detected->views);
  c.notes = std::move(detected->notes);
  c.figures.resize(c.scene.cameras.size());
  for (const ViewFolder& f : folders)
    c.warnings.insert(c.warnings.end(), f.warnings.begin(), f.warnings.end());
  if (c.scene.sightings.empty()) {
    c.failed_gates.push_back("no board was found in any picture: does board.json state its inner corners?");
    c.rig = nominal.rig;
    return c;
  }
  stage("starting every camera");
  StartLenses(c);
  StartPoses(c.scene);
  stage("adjusting all cameras together");
  if (auto ok = AdjustRobustly(c.scene); !ok) return tl::unexpected(ok.error());
  stage("comparing every pixel near an edge");
  const auto pictures = RefineOnPixels(c);
  if (!pictures) return tl::unexpected(pictures.error());
  auto deviations = pictures->empty() ? DeviationsByCorners(c.scene) : DeviationsByPixels(*pictures, c.scene);
  if (deviations) {
    c.deviations = std::move(*deviations);
  } else {
    c.failed_gates.push_back(deviations.error().message);
  }
  stage("measuring what it is worth");
  if (auto ok = HoldOut(c, *pictures, c.figures); !ok) return tl::unexpected(ok.error());
  const auto opencv = MeasureOpenCv(c.scene);
  for (std::size_t i = 0; i < c.figures.size(); ++i) {
    MeasureCamera(c.scene, i, c.figures[i]);
    c.figures[i].opencv = opencv[i];
  }
  if (const auto depth = CameraNamed(c.scene, kDepthName); depth && c.scene.cameras[*depth].T_first_camera) {
    stage("fitting the ToF camera's range error");
    CalibrateRange(nominal, *depth, c);
  }
  FillRig(nominal, c);
  if (const auto views = HandEyeViews(c)) {
    stage("fitting the head's axes");
    if (auto hand_eye = CalibrateHandEye(*views)) {
      c.rig.ptu = hand_eye->ptu;
      c.hand_eye = std::move(*hand_eye);
    } else {
      c.failed_gates.push_back(hand_eye.error().message);
    }
  }
  JudgeCalibration(c);
  return c;
}

}  // namespace mixstage
