// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/joint_adjustment.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

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

struct Numbers {
  std::vector<std::array<double, kLensNumbers>> lenses;
  std::vector<PoseNumbers> cameras, boards;
};

Numbers NumbersOfScene(const BoardScene& scene) {
  Numbers n;
  for (const SceneCamera& c : scene.cameras) {
    n.lenses.push_back(c.lens.numbers);
    n.cameras.push_back(NumbersOf(c.T_first_camera.value_or(RigidTransform::Identity())));
  }
  for (const Placement& p : scene.placements)
    n.boards.push_back(NumbersOf(p.T_first_board.value_or(RigidTransform::Identity())));
  return n;
}

enum class Part {
  kCameras = 1,  // cameras and the boards they learn from
  kHeldOut,      // poses of the held-out boards, cameras fixed
};

Result<AdjustmentSummary> Solve(BoardScene& scene, Part part) {
  Numbers n = NumbersOfScene(scene);
  ceres::Problem problem;
  auto order = std::make_shared<ceres::ParameterBlockOrdering>();
  std::vector<bool> camera_used(scene.cameras.size());
  for (const SceneSighting& s : scene.sightings) {
    const Placement& placement = scene.placements[s.placement];
    if (!scene.Used(s) || placement.held_out != (part == Part::kHeldOut)) continue;
    const SceneCamera& camera = scene.cameras[s.camera];
    camera_used[s.camera] = true;
    double* board = n.boards[s.placement].data();
    for (std::size_t i = 0; i < s.corners.corners.size(); ++i) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<CornerCost, 2, kLensNumbers, 6, 6>(
              new CornerCost{camera.lens.kind, scene.boards[placement.board].Corner(s.corners.corners[i]),
                             s.corners.pixels[i], camera.corner_sigma_px}),
          new ceres::CauchyLoss(3.0), n.lenses[s.camera].data(), n.cameras[s.camera].data(), board);
    }
    order->AddElementToGroup(board, 0);
  }
  if (problem.NumResidualBlocks() == 0) return AdjustmentSummary{};
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    if (!camera_used[c]) continue;
    double* lens = n.lenses[c].data();
    double* pose = n.cameras[c].data();
    order->AddElementToGroup(lens, 1);
    order->AddElementToGroup(pose, 1);
    std::vector<int> fixed;
    const std::vector<int>& free = scene.cameras[c].lens.free;
    for (int i = 0; i < kLensNumbers; ++i) {
      if (std::find(free.begin(), free.end(), i) == free.end()) fixed.push_back(i);
    }
    if (part == Part::kHeldOut || free.empty()) {
      problem.SetParameterBlockConstant(lens);
    } else if (!fixed.empty()) {
      problem.SetManifold(lens, new ceres::SubsetManifold(kLensNumbers, fixed));
    }
    if (c == 0 || part == Part::kHeldOut) problem.SetParameterBlockConstant(pose);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = order;
  options.max_num_iterations = 100;
  options.function_tolerance = 1e-9;
  options.parameter_tolerance = 1e-10;
  options.num_threads = 2;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable())
    return Fail(ErrorCode::kInternal, "the adjustment failed: " + summary.message);
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    if (!camera_used[c] || part == Part::kHeldOut) continue;
    scene.cameras[c].lens.numbers = n.lenses[c];
    if (c > 0) scene.cameras[c].T_first_camera = TransformOf(n.cameras[c]);
  }
  for (std::size_t p = 0; p < scene.placements.size(); ++p) {
    if (scene.placements[p].T_first_board && scene.placements[p].held_out == (part == Part::kHeldOut))
      scene.placements[p].T_first_board = TransformOf(n.boards[p]);
  }
  return AdjustmentSummary{summary.final_cost, static_cast<int>(summary.iterations.size()),
                           summary.termination_type == ceres::CONVERGENCE};
}

double Rms(const std::vector<Vector2d>& residuals) {
  double sum = 0;
  for (const Vector2d& r : residuals) sum += r.squaredNorm();
  return residuals.empty() ? 0 : std::sqrt(sum / static_cast<double>(residuals.size()));
}

// Sets rms_px of every sighting and corner_sigma_px of every camera; false where a sigma changed by more than
// a tenth.
bool MeasureNoise(BoardScene& scene) {
  bool settled = true;
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    std::vector<double> coordinates;
    for (SceneSighting& s : scene.sightings) {
      if (s.camera != c || !scene.cameras[c].T_first_camera || !scene.placements[s.placement].T_first_board)
        continue;
      const auto residuals = CornerResiduals(scene, s);
      s.rms_px = Rms(residuals);
      if (!s.left_out.empty() || scene.placements[s.placement].held_out) continue;
      for (const Vector2d& r : residuals)
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

Result<AdjustmentSummary> AdjustJointly(BoardScene& scene) {
  auto summary = Solve(scene, Part::kCameras);
  if (!summary) return summary;
  if (auto held_out = Solve(scene, Part::kHeldOut); !held_out) return held_out;
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

}  // namespace mixstage
