// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/adjustment_problem.h"

#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

// J^T J of a row-compressed Jacobian.
Eigen::MatrixXd NormalMatrix(const ceres::CRSMatrix& J) {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(J.num_cols, J.num_cols);
  auto index = [](int i) { return static_cast<std::size_t>(i); };
  for (int row = 0; row < J.num_rows; ++row) {
    for (int a = J.rows[index(row)]; a < J.rows[index(row) + 1]; ++a) {
      for (int b = J.rows[index(row)]; b <= a; ++b)
        H(J.cols[index(a)], J.cols[index(b)]) += J.values[index(a)] * J.values[index(b)];
    }
  }
  // A row's columns rise within a block but not across blocks: either triangle may hold an entry.
  const Eigen::MatrixXd both = H + H.transpose();
  return both - Eigen::MatrixXd(H.diagonal().asDiagonal());
}

}  // namespace

AdjustmentProblem::AdjustmentProblem(const BoardScene& scene, AdjustedPart part) : part_(part) {
  for (const SceneCamera& c : scene.cameras) {
    lenses_.push_back(c.lens.numbers);
    camera_poses_.push_back(NumbersOf(c.T_first_camera.value_or(RigidTransform::Identity())));
  }
  for (const Placement& p : scene.placements)
    board_poses_.push_back(NumbersOf(p.T_first_board.value_or(RigidTransform::Identity())));
}

void AdjustmentProblem::Constrain(const BoardScene& scene) {
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    if (!problem_.HasParameterBlock(lens(c))) continue;
    const std::vector<int>& free = scene.cameras[c].lens.free;
    std::vector<int> fixed;
    for (int i = 0; i < kLensNumbers; ++i) {
      if (std::find(free.begin(), free.end(), i) == free.end()) fixed.push_back(i);
    }
    if (part_ == AdjustedPart::kHeldOut || free.empty()) {
      problem_.SetParameterBlockConstant(lens(c));
    } else if (!fixed.empty()) {
      problem_.SetManifold(lens(c), new ceres::SubsetManifold(kLensNumbers, fixed));
    }
    if (c == 0 || part_ == AdjustedPart::kHeldOut) problem_.SetParameterBlockConstant(camera_pose(c));
  }
}

Result<AdjustmentSummary> AdjustmentProblem::Solve(const BoardScene& scene, int most_iterations,
                                                   double function_tolerance) {
  if (problem_.NumResidualBlocks() == 0) return AdjustmentSummary{};
  Constrain(scene);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  auto order = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::size_t p = 0; p < board_poses_.size(); ++p) {
    if (problem_.HasParameterBlock(board_pose(p))) order->AddElementToGroup(board_pose(p), 0);
  }
  for (std::size_t c = 0; c < lenses_.size(); ++c) {
    if (!problem_.HasParameterBlock(lens(c))) continue;
    order->AddElementToGroup(lens(c), 1);
    order->AddElementToGroup(camera_pose(c), 1);
  }
  options.linear_solver_ordering = order;
  options.max_num_iterations = most_iterations;
  options.function_tolerance = function_tolerance;
  options.parameter_tolerance = 1e-10;
  options.num_threads = 2;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem_, &summary);
  if (!summary.IsSolutionUsable())
    return Fail(ErrorCode::kInternal, "the adjustment failed: " + summary.message);
  return AdjustmentSummary{summary.final_cost, static_cast<int>(summary.iterations.size()),
                           summary.termination_type == ceres::CONVERGENCE};
}

void AdjustmentProblem::Store(BoardScene& scene) const {
  auto in_problem = [&](const auto& block) { return problem_.HasParameterBlock(block.data()); };
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    if (part_ == AdjustedPart::kHeldOut || !in_problem(lenses_[c])) continue;
    scene.cameras[c].lens.numbers = lenses_[c];
    if (c > 0) scene.cameras[c].T_first_camera = TransformOf(camera_poses_[c]);
  }
  for (std::size_t p = 0; p < scene.placements.size(); ++p) {
    if (in_problem(board_poses_[p])) scene.placements[p].T_first_board = TransformOf(board_poses_[p]);
  }
}

Result<Deviations> AdjustmentProblem::DeviationsHere(const BoardScene& scene) {
  Constrain(scene);
  struct Column {
    std::size_t camera;
    int number;  // of the lens, or kLensNumbers + of the pose
  };
  std::vector<Column> columns;
  std::vector<double*> blocks;
  Deviations deviations(scene.cameras.size());
  for (std::size_t c = 0; c < scene.cameras.size(); ++c) {
    if (!problem_.HasParameterBlock(lens(c))) continue;
    deviations[c].emplace();
    if (!problem_.IsParameterBlockConstant(lens(c))) {
      blocks.push_back(lens(c));
      for (int i : scene.cameras[c].lens.free) columns.push_back({c, i});
    }
    if (!problem_.IsParameterBlockConstant(camera_pose(c))) {
      blocks.push_back(camera_pose(c));
      for (int i = 0; i < 6; ++i) columns.push_back({c, kLensNumbers + i});
    }
  }
  if (columns.empty()) return deviations;
  for (std::size_t p = 0; p < board_poses_.size(); ++p) {
    if (problem_.HasParameterBlock(board_pose(p))) blocks.push_back(board_pose(p));
  }
  ceres::Problem::EvaluateOptions options;
  options.parameter_blocks = blocks;
  options.apply_loss_function = false;
  ceres::CRSMatrix J;
  if (!problem_.Evaluate(options, nullptr, nullptr, nullptr, &J))
    return Fail(ErrorCode::kInternal, "the adjustment's Jacobian cannot be computed");
  const Eigen::MatrixXd H = NormalMatrix(J);
  const Eigen::VectorXd scale = H.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * H * scale.asDiagonal());
  constexpr double kSingular = 1e-13;  // of a matrix with ones on its diagonal: rounding
  if (!(eigen.eigenvalues()(0) > kSingular)) {
    Eigen::Index worst = 0;
    eigen.eigenvectors().col(0).head(static_cast<Eigen::Index>(columns.size())).cwiseAbs().maxCoeff(&worst);
    const Column& column = columns[static_cast<std::size_t>(worst)];
    const SceneCamera& camera = scene.cameras[column.camera];
    return Fail(ErrorCode::kQualityGate,
                camera.name + ": the views do not determine " +
                    (column.number < kLensNumbers ? LensNumberName(camera.lens.kind, column.number)
                                                  : std::string("where the camera sits on the head")));
  }
  const auto covariance = [&](std::size_t a, std::size_t b) {
    const auto i = static_cast<Eigen::Index>(a), k = static_cast<Eigen::Index>(b);
    return (eigen.eigenvectors().row(i).array() * eigen.eigenvectors().row(k).array() /
            eigen.eigenvalues().transpose().array())
               .sum() *
           scale(i) * scale(k);
  };
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const double sigma = std::sqrt(covariance(k, k));
    CameraDeviation& d = *deviations[columns[k].camera];
    for (std::size_t other = 0; other < columns.size(); ++other)
      if (columns[other].camera == columns[k].camera && columns[k].number < kLensNumbers &&
          columns[other].number < kLensNumbers)
        d.lens_covariance(columns[k].number, columns[other].number) = covariance(k, other);
    const int n = columns[k].number;
    if (n < kLensNumbers) {
      d.lens[static_cast<std::size_t>(n)] = sigma;
    } else if (n < kLensNumbers + 3) {
      d.turn_deg(n - kLensNumbers) = sigma * 180 / std::numbers::pi;
    } else {
      d.shift_m(n - kLensNumbers - 3) = sigma;
    }
  }
  return deviations;
}

}  // namespace mixstage
