// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/joint_adjustment.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "server/calibration/adjustment_problem.h"

namespace mixstage {
namespace {

using Eigen::Vector2d;

// (projected - observed) / sigma of one corner.
struct CornerCost {
  LensKind kind;
  Eigen::Vector3d corner;
  Vector2d observed;
  double sigma_px;

  template <typename T>
  bool operator()(const T* lens, const T* first_camera, const T* first_board, T* residual) const {
    const T point[3] = {T(corner.x()), T(corner.y()), T(corner.z())};
    T p_first[3];
    ceres::AngleAxisRotatePoint(first_board, point, p_first);
    T shifted[3];
    for (int i = 0; i < 3; ++i) shifted[i] = p_first[i] + first_board[3 + i] - first_camera[3 + i];
    const T back[3] = {-first_camera[0], -first_camera[1], -first_camera[2]};
    T p_camera[3];
    ceres::AngleAxisRotatePoint(back, shifted, p_camera);
    T pixel[2];
    ProjectThrough(kind, lens, p_camera, pixel);
    residual[0] = (pixel[0] - T(observed.x())) / T(sigma_px);
    residual[1] = (pixel[1] - T(observed.y())) / T(sigma_px);
    return true;
  }
};

void AddCorners(const BoardScene& scene, AdjustmentProblem& adjustment) {
  for (const SceneSighting& s : scene.sightings) {
    if (!adjustment.Takes(scene, s)) continue;
    const SceneCamera& camera = scene.cameras[s.camera];
    const Board& board = scene.boards[scene.placements[s.placement].board];
    for (std::size_t i = 0; i < s.corners.corners.size(); ++i) {
      adjustment.problem().AddResidualBlock(
          new ceres::AutoDiffCostFunction<CornerCost, 2, kLensNumbers, 6, 6>(
              new CornerCost{camera.lens.kind, board.Corner(s.corners.corners[i]), s.corners.pixels[i],
                             camera.corner_sigma_px}),
          new ceres::CauchyLoss(3.0), adjustment.lens(s.camera), adjustment.camera_pose(s.camera),
          adjustment.board_pose(s.placement));
    }
  }
}

Result<AdjustmentSummary> Solve(BoardScene& scene, AdjustedPart part) {
  AdjustmentProblem adjustment(scene, part);
  AddCorners(scene, adjustment);
  auto summary = adjustment.Solve(scene, 100, 1e-9);
  if (summary) adjustment.Store(scene);
  return summary;
}

double Rms(const std::vector<Vector2d>& residuals) {
  double sum = 0;
  for (const Vector2d& r : residuals) sum += r.squaredNorm();
  return residuals.empty() ? 0 : std::sqrt(sum / static_cast<double>(residuals.size()));
}

// Sets corner_sigma_px of every camera; false where one changed by more than a tenth.
bool MeasureNoise(BoardScene& scene) {
  bool settled = true;
  MeasureCorners(scene);
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    std::vector<double> coordinates;
    for (const SceneSighting& s : scene.sightings) {
      if (s.camera != c || !scene.Used(s) || scene.placements[s.placement].held_out) continue;
      for (const Vector2d& r : CornerResiduals(scene, s))
        coordinates.insert(coordinates.end(), {std::abs(r.x()), std::abs(r.y())});
    }
    if (coordinates.size() < 20) continue;
    const auto middle = coordinates.begin() + static_cast<std::ptrdiff_t>(coordinates.size() / 2);
    std::nth_element(coordinates.begin(), middle, coordinates.end());
    const double sigma = std::max(1.4826 * *middle, 1e-4);
    settled = settled && std::abs(sigma / scene.cameras[c].corner_sigma_px - 1) < 0.1;
    scene.cameras[c].corner_sigma_px = sigma;
  }
  return settled;
}

// True where a sighting fell out.
bool LeaveOutFarOnes(BoardScene& scene) {
  bool changed = false;
  for (SceneSighting& s : scene.sightings) {
    if (!scene.Used(s)) continue;
    const double limit = std::max(0.5, 4 * std::numbers::sqrt2 * scene.cameras[s.camera].corner_sigma_px);
    if (s.rms_px <= limit) continue;
    char text[120];
    std::snprintf(text, sizeof(text), "corners lie %.2f px rms from where the other pictures put them",
                  s.rms_px);
    s.left_out = text;
    changed = true;
  }
  return changed;
}

}  // namespace

void MeasureCorners(BoardScene& scene) {
  for (SceneSighting& s : scene.sightings) {
    if (scene.cameras[s.camera].T_first_camera && scene.placements[s.placement].T_first_board)
      s.rms_px = Rms(CornerResiduals(scene, s));
  }
}

Result<AdjustmentSummary> AdjustJointly(BoardScene& scene) {
  auto summary = Solve(scene, AdjustedPart::kCameras);
  if (!summary) return summary;
  if (auto held_out = Solve(scene, AdjustedPart::kHeldOut); !held_out) return held_out;
  return summary;
}

Result<AdjustmentSummary> AdjustRobustly(BoardScene& scene) {
  constexpr int kMostRounds = 8;
  Result<AdjustmentSummary> summary;
  for (int round = 0; round < kMostRounds; ++round) {
    summary = AdjustJointly(scene);
    if (!summary) return summary;
    const bool settled = MeasureNoise(scene);
    // Outliers are judged once sigma is theirs to be judged by.
    const bool changed = settled && LeaveOutFarOnes(scene);
    if (settled && !changed) break;
  }
  return summary;
}

Result<Deviations> DeviationsByCorners(const BoardScene& scene) {
  AdjustmentProblem adjustment(scene, AdjustedPart::kCameras);
  AddCorners(scene, adjustment);
  return adjustment.DeviationsHere(scene);
}

}  // namespace mixstage
