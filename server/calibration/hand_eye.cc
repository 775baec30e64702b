// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/hand_eye.h"

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <optional>

#include "proto/base/text.h"
#include "server/calibration/hand_eye_solve.h"
#include "server/calibration/head_base.h"
#include "server/calibration/weak_directions.h"

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180, kDeg = 1 / kRadPerDeg;
// What is weak: worse than this shows in a room (0.05 deg are 4 mm at 5 m).
constexpr double kWeakRad = 0.05 * kRadPerDeg, kWeakM = 0.002;
constexpr double kWorstNoiseRad = 0.3 * kRadPerDeg;

RigidTransform Turn(const Eigen::Vector3d& axis, double angle_rad) {
  return RigidTransform(Eigen::AngleAxisd(angle_rad, axis));
}

}  // namespace

Result<HandEyeResult> CalibrateHandEye(const HandEyeInput& input) {
  HandEyeSolve solve(input.boards, HeadKind::kPanTilt, input.views.size());
  HandEyeAdjustment& problem = solve.problem;
  // Color first, whether or not the others exist.
  problem.cameras.push_back({.lens = LensOf(input.rig.color)});
  problem.cameras.push_back({.lens = input.rig.depth ? LensOf(input.rig.depth->camera) : Lens{},
                             .T_camera_color = input.rig.T_color_depth.inverse()});
  problem.cameras.push_back({.lens = input.rig.fisheye ? LensOf(*input.rig.fisheye) : Lens{},
                             .T_camera_color = input.rig.T_color_fisheye.inverse()});
  problem.cameras[0].lens_covariance = input.color_covariance;
  problem.cameras[1].lens_covariance = input.depth_covariance;
  problem.cameras[2].lens_covariance = input.fisheye_covariance;
  for (auto& camera : problem.cameras) camera.lens_expected = camera.lens.numbers;
  const std::optional<PanTilt>& nominal = input.rig.ptu;
  const double pan_scale = nominal ? std::abs(nominal->pan_scale) : 1,
               tilt_scale = nominal ? std::abs(nominal->tilt_scale) : 1;
  problem.mechanism = problem.mechanism_expected = {0, 0, pan_scale, tilt_scale};
  for (std::size_t v = 0; v < input.views.size(); ++v) {
    const HeadView& view = input.views[v];
    if (!std::isfinite(view.pan_deg) || !std::isfinite(view.tilt_deg))
      return Fail(ErrorCode::kBadInput, view.name + ": pan or tilt is not finite");
    solve.names.push_back(view.name);
    solve.fits[v].name = view.name;
    problem.views[v].pan_rad = view.pan_deg * kRadPerDeg;
    problem.views[v].tilt_rad = view.tilt_deg * kRadPerDeg;
    solve.T_base_hand.push_back(Turn(Eigen::Vector3d::UnitZ(), pan_scale * problem.views[v].pan_rad) *
                                Turn(-Eigen::Vector3d::UnitY(), tilt_scale * problem.views[v].tilt_rad));
    const std::vector<BoardSighting>* by_camera[] = {&view.color, &view.amplitude, &view.fisheye};
    for (std::size_t camera = 0; camera < 3; ++camera) {
      // What is left of the other cameras' errors would weigh more than their coarser pixels tell.
      if (camera > 0 && !view.color.empty()) break;
      for (const BoardSighting& sighting : *by_camera[camera]) {
        if (auto ok = CheckSighting(view.name, input.boards, sighting); !ok)
          return tl::unexpected(ok.error());
        if (problem.cameras[camera].lens.width == 0)
          return Fail(ErrorCode::kBadInput, view.name + ": the rig lacks a camera that sees a board");
        solve.seen.push_back({v, camera, &sighting});
      }
    }
  }
  Eigen::Matrix3d guess;  // the camera looks along x with its x axis to the right
  guess << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  std::optional<RigidTransform> T_base_own;
  if (nominal) {
    T_base_own = BaseOfNominal(*nominal);
    PanTilt at_zero = *nominal;
    at_zero.T_world_base = T_base_own->inverse();
    guess = at_zero.TWorldColor(0, 0).linear();
  }
  if (auto ok = Start(solve, guess); !ok) return tl::unexpected(ok.error());
  if (auto ok = Fit(solve); !ok) return tl::unexpected(ok.error());
  if (problem.encoder_noise.maxCoeff() > kWorstNoiseRad)
    return Fail(ErrorCode::kQualityGate, "hand-eye: the encoders scatter by " +
                                             Text("%.2f deg", problem.encoder_noise.maxCoeff() * kDeg) +
                                             "; more than 0.3 is no pan-tilt head that stands still");

  if (!T_base_own) T_base_own = BaseByConvention(problem.T_hand_color);
  HandEyeResult result;
  result.ptu = InBase(problem, nominal, *T_base_own);
  for (const RigidTransform& T : problem.T_base_board) result.T_base_board.push_back(*T_base_own * T);
  result.views = solve.fits;
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    result.views[v].pan_correction_deg = problem.views[v].correction[0] * kDeg;
    result.views[v].tilt_correction_deg = problem.views[v].correction[1] * kDeg;
  }
  result.pan_noise_deg = problem.encoder_noise[0] * kDeg;
  result.tilt_noise_deg = problem.encoder_noise[1] * kDeg;
  result.held = solve.held;
  std::vector<Eigen::Vector2d> sweep;
  for (int pan = -2; pan <= 2; ++pan)
    for (int tilt = -2; tilt <= 2; ++tilt) sweep.push_back(Eigen::Vector2d(20 * pan, 17 * tilt) * kRadPerDeg);
  const RelativeDeviation deviation = DeviationBetween(problem, sweep);
  result.sweep_sd_deg = deviation.rotation_rad * kDeg;
  result.sweep_sd_mm = deviation.translation * 1000;
  for (const auto& sighting : problem.sightings) {
    double* noise[] = {&result.color_noise_px, &result.amplitude_noise_px, &result.fisheye_noise_px};
    if (sighting.used) *noise[sighting.camera] = problem.cameras[sighting.camera].noise_px;
  }

  const std::vector<Direction> directions{
      {"distance of the axes", kWeakM, 1000, "%.1f mm"},
      {"skew of the axes", kWeakRad, kDeg, "%.3f deg"},
      {"pan scale", kWeakRad, 100, "%.3f %%"},
      {"tilt scale", kWeakRad, 100, "%.3f %%"},
      {"camera's turn about the axes' common perpendicular", kWeakRad, kDeg, "%.3f deg"},
      {"camera's turn about the tilt axis", kWeakRad, kDeg, "%.3f deg"},
      {"camera's turn about the pan axis", kWeakRad, kDeg, "%.3f deg"},
      {"camera's place along the axes' common perpendicular", kWeakM, 1000, "%.1f mm"},
      {"camera's place along the tilt axis", kWeakM, 1000, "%.1f mm"},
      {"camera's place along the pan axis", kWeakM, 1000, "%.1f mm"}};
  result.weak = WeakDirections(problem.covariance, directions);
  const Eigen::Vector3d place = problem.T_hand_color.translation();
  const double values[] = {problem.mechanism[0],
                           problem.mechanism[1],
                           problem.mechanism[2],
                           problem.mechanism[3],
                           place.x(),
                           place.y(),
                           place.z()};
  for (std::size_t i = 0; i < directions.size(); ++i) {
    if (i >= 4 && i < 7) continue;  // turns: their values are T_tilt_color's
    const Direction& d = directions[i];
    const bool scale = i == 2 || i == 3;
    const double per_unit = scale ? 1 : d.per_unit;
    const auto at = static_cast<Eigen::Index>(i);
    result.figures.push_back({d.name, values[i < 4 ? i : i - 3] * per_unit,
                              std::sqrt(problem.covariance(at, at)) * per_unit,
                              scale    ? "1"
                              : i == 1 ? "deg"
                                       : "mm"});
  }
  return result;
}

Result<RobotHandEyeResult> CalibrateRobotHandEye(const RobotHandEyeInput& input) {
  HandEyeSolve solve(input.boards, HeadKind::kRobot, input.views.size());
  HandEyeAdjustment& problem = solve.problem;
  problem.cameras.push_back({.lens = LensOf(input.camera)});
  problem.encoder_noise = {0.1 * kRadPerDeg, 0.001};
  for (std::size_t v = 0; v < input.views.size(); ++v) {
    const RobotView& view = input.views[v];
    if (!view.T_base_hand.matrix().allFinite())
      return Fail(ErrorCode::kBadInput, view.name + ": the hand's pose is not finite");
    solve.names.push_back(view.name);
    solve.fits[v].name = view.name;
    problem.views[v].T_base_hand = view.T_base_hand;
    solve.T_base_hand.push_back(view.T_base_hand);
    for (const BoardSighting& sighting : view.sightings) {
      if (auto ok = CheckSighting(view.name, input.boards, sighting); !ok) return tl::unexpected(ok.error());
      solve.seen.push_back({v, 0, &sighting});
    }
  }
  if (auto ok = Start(solve, Eigen::Matrix3d::Identity()); !ok) return tl::unexpected(ok.error());
  if (auto ok = Fit(solve); !ok) return tl::unexpected(ok.error());

  RobotHandEyeResult result;
  result.T_hand_color = problem.T_hand_color;
  result.T_base_board = problem.T_base_board;
  result.views = solve.fits;
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    result.views[v].rotation_correction_deg = problem.views[v].correction.head<3>().norm() * kDeg;
    result.views[v].translation_correction_mm = problem.views[v].correction.tail<3>().norm() * 1000;
  }
  result.rotation_noise_deg = problem.encoder_noise[0] * kDeg;
  result.translation_noise_mm = problem.encoder_noise[1] * 1000;
  result.noise_px = problem.cameras[0].noise_px;
  std::vector<Direction> directions;
  for (const char* axis : {"x", "y", "z"})
    directions.push_back({std::string("camera's turn about the hand's ") + axis, kWeakRad, kDeg, "%.3f deg"});
  for (const char* axis : {"x", "y", "z"})
    directions.push_back({std::string("camera's place along the hand's ") + axis, kWeakM, 1000, "%.1f mm"});
  const Eigen::MatrixXd covariance = problem.covariance.bottomRightCorner(6, 6);
  result.weak = WeakDirections(covariance, directions);
  for (Eigen::Index i = 0; i < 6; ++i) {
    const Direction& d = directions[static_cast<std::size_t>(i)];
    const double value = i < 3 ? 0 : problem.T_hand_color.translation()[i - 3] * 1000;
    if (i >= 3) result.figures.push_back({d.name, value, std::sqrt(covariance(i, i)) * 1000, "mm"});
  }
  return result;
}

}  // namespace mixstage
