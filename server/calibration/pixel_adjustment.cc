// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/pixel_adjustment.h"

#include <ceres/cost_function.h>

#include <atomic>
#include <cmath>
#include <map>
#include <mutex>
#include <thread>

#include "server/calibration/adjustment_problem.h"

namespace mixstage {
namespace {

// U with U^T U = normal; rows of numbers that nothing depends on (beyond others before them) are zero.
FitNormal UpperRoot(const FitNormal& normal) {
  FitNormal U = FitNormal::Zero();
  for (int i = 0; i <= kFitNumbers; ++i) {
    const double pivot = normal(i, i) - U.col(i).head(i).squaredNorm();
    if (!(pivot > 1e-11 * normal(i, i))) continue;
    U(i, i) = std::sqrt(pivot);
    for (int j = i + 1; j <= kFitNumbers; ++j)
      U(i, j) = (normal(i, j) - U.col(i).head(i).dot(U.col(j).head(i))) / U(i, i);
  }
  return U;
}

class PictureCost : public ceres::CostFunction {
 public:
  explicit PictureCost(const BoardPictureFit& fit) : fit_(fit) {
    set_num_residuals(kFitNumbers + 1);
    for (int size : {kLensNumbers, 6, 6}) mutable_parameter_block_sizes()->push_back(size);
  }
  bool Evaluate(const double* const* blocks, double* residuals, double** jacobians) const override {
    FitNormal normal;
    fit_.Accumulate({blocks[0], blocks[1], blocks[2]}, normal);
    if (!normal.allFinite()) return false;
    const FitNormal U = UpperRoot(normal);
    for (int i = 0; i <= kFitNumbers; ++i) residuals[i] = U(i, kFitNumbers);
    if (!jacobians) return true;
    int first = 0;
    for (int block = 0; block < 3; ++block) {
      const int size = block == 0 ? kLensNumbers : 6;
      if (jacobians[block]) {
        Eigen::Map<Eigen::Matrix<double, kFitNumbers + 1, Eigen::Dynamic, Eigen::RowMajor>> J(
            jacobians[block], kFitNumbers + 1, size);
        J = U.middleCols(first, size);
      }
      first += size;
    }
    return true;
  }

 private:
  const BoardPictureFit& fit_;
};

void AddPictures(const std::vector<FittedPicture>& pictures, const BoardScene& scene, AdjustedPart part,
                 AdjustmentProblem& adjustment) {
  for (const FittedPicture& p : pictures) {
    if (scene.placements[p.placement].held_out != (part == AdjustedPart::kHeldOut)) continue;
    adjustment.problem().AddResidualBlock(new PictureCost(p.fit), nullptr, adjustment.lens(p.camera),
                                          adjustment.camera_pose(p.camera),
                                          adjustment.board_pose(p.placement));
  }
}

}  // namespace

std::vector<FittedPicture> FitPictures(const BoardScene& scene, const BrightnessOf& brightness_of) {
  // By camera and view, so that a picture with two boards is read once.
  std::map<std::pair<std::size_t, std::size_t>, std::vector<std::size_t>> placements;
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    for (std::size_t p = 0; p < scene.placements.size(); ++p) {
      if (!scene.cameras[c].T_first_camera || !scene.placements[p].T_first_board) continue;
      bool left_out = false;
      bool used_by_any = false;
      for (const SceneSighting& s : scene.sightings) {
        if (s.placement != p) continue;
        if (s.camera == c && !s.left_out.empty()) left_out = true;
        used_by_any = used_by_any || scene.Used(s);
      }
      if (!left_out && used_by_any) placements[{c, scene.placements[p].view_index}].push_back(p);
    }
  }
  const std::vector<std::pair<std::pair<std::size_t, std::size_t>, std::vector<std::size_t>>> jobs(
      placements.begin(), placements.end());
  std::vector<std::vector<FittedPicture>> fitted(jobs.size());
  std::atomic<std::size_t> next = 0;
  auto work = [&] {
    for (std::size_t i = next++; i < jobs.size(); i = next++) {
      const auto& [key, list] = jobs[i];
      const auto brightness = brightness_of(key.first, key.second);
      if (!brightness) continue;
      const SceneCamera& camera = scene.cameras[key.first];
      for (std::size_t p : list) {
        auto fit = BoardPictureFit::Prepare(*brightness, camera.lens, scene.boards[scene.placements[p].board],
                                            *camera.T_first_camera, *scene.placements[p].T_first_board);
        if (fit) fitted[i].push_back({key.first, p, std::move(*fit)});
      }
    }
  };
  {
    std::vector<std::jthread> threads;
    for (unsigned t = 0; t < std::max(1u, std::thread::hardware_concurrency()); ++t)
      threads.emplace_back(work);
  }
  std::vector<FittedPicture> all;
  for (auto& some : fitted) {
    for (FittedPicture& f : some) all.push_back(std::move(f));
  }
  return all;
}

Result<AdjustmentSummary> AdjustToPixels(const std::vector<FittedPicture>& pictures, BoardScene& scene,
                                         int most_iterations) {
  AdjustmentSummary summary;
  for (AdjustedPart part : {AdjustedPart::kCameras, AdjustedPart::kHeldOut}) {
    AdjustmentProblem adjustment(scene, part);
    AddPictures(pictures, scene, part, adjustment);
    auto solved = adjustment.Solve(scene, most_iterations, 1e-6);
    if (!solved) return solved;
    adjustment.Store(scene);
    if (part == AdjustedPart::kCameras) summary = *solved;
  }
  return summary;
}

Result<Deviations> DeviationsByPixels(const std::vector<FittedPicture>& pictures, const BoardScene& scene) {
  AdjustmentProblem adjustment(scene, AdjustedPart::kCameras);
  AddPictures(pictures, scene, AdjustedPart::kCameras, adjustment);
  return adjustment.DeviationsHere(scene);
}

}  // namespace mixstage
