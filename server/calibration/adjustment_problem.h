// SPDX-License-Identifier: Apache-2.0
//
// A scene's numbers as parameter blocks of a Ceres problem, which of them are free, and the way back. Whoever
// adjusts adds its own residuals.
#pragma once

#include <ceres/problem.h>

#include <optional>
#include <vector>

#include "server/calibration/adjustment_summary.h"
#include "server/calibration/board_scene.h"
#include "server/calibration/deviations.h"

namespace mixstage {

enum class AdjustedPart {
  kCameras = 1,  // cameras and the boards they learn from
  kHeldOut,      // poses of the held-out boards, cameras fixed
};

class AdjustmentProblem {
 public:
  // The scene must not lose cameras or placements while this lives; it is read here and in Store only.
  AdjustmentProblem(const BoardScene& scene, AdjustedPart part);

  // Blocks to hand to residuals: [kLensNumbers], [6] T_first_camera, [6] T_first_board.
  double* lens(std::size_t camera) { return lenses_[camera].data(); }
  double* camera_pose(std::size_t camera) { return camera_poses_[camera].data(); }
  double* board_pose(std::size_t placement) { return board_poses_[placement].data(); }
  ceres::Problem& problem() { return problem_; }

  // Is the sighting part of what is adjusted?
  [[nodiscard]] bool Takes(const BoardScene& scene, const SceneSighting& sighting) const {
    return scene.Used(sighting) &&
           scene.placements[sighting.placement].held_out == (part_ == AdjustedPart::kHeldOut);
  }

  Result<AdjustmentSummary> Solve(const BoardScene& scene, int most_iterations, double function_tolerance);
  void Store(BoardScene& scene) const;

  // From the Jacobian where the numbers stand, boards' poses marginalised. Fails (kQualityGate, the number
  // named) where one is not determined.
  Result<Deviations> DeviationsHere(const BoardScene& scene);

 private:
  // Fixes what is not estimated; blocks without residuals are left alone.
  void Constrain(const BoardScene& scene);

  AdjustedPart part_;
  std::vector<std::array<double, kLensNumbers>> lenses_;
  std::vector<PoseNumbers> camera_poses_, board_poses_;
  ceres::Problem problem_;
};

}  // namespace mixstage
