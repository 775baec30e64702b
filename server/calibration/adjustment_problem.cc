// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/adjustment_problem.h"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>
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

// What each board says of the cameras where all of them agree best: the sum of these pulls is zero, their
// spread is what boards contradict each other by.
struct BoardPull {
  Eigen::VectorXd pull;     // gradient by the cameras' numbers, its own pose marginalised
  Eigen::MatrixXd expects;  // covariance of it if the pixels' (corners') noise is all there is
};

// covariance: of the cameras' numbers by all boards together.
std::vector<BoardPull> PullsOfBoards(const ceres::CRSMatrix& J, const std::vector<double>& residuals,
                                     Eigen::Index camera_columns, const Eigen::MatrixXd& covariance) {
  std::map<int, std::vector<int>> rows_of;  // by the first column of the board's pose
  for (int row = 0; row < J.num_rows; ++row) {
    int board = -1;
    for (int a = J.rows[static_cast<std::size_t>(row)]; a < J.rows[static_cast<std::size_t>(row) + 1]; ++a) {
      const int column = J.cols[static_cast<std::size_t>(a)];
      if (column >= camera_columns) board = static_cast<int>((column - camera_columns) / 6);
    }
    if (board >= 0) rows_of[board].push_back(row);
  }
  std::vector<BoardPull> pulls;
  for (const auto& [board, rows] : rows_of) {
    const Eigen::Index n = camera_columns + 6;
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(n, n);
    Eigen::VectorXd g = Eigen::VectorXd::Zero(n);
    Eigen::VectorXd dense(n);
    for (const int row : rows) {
      dense.setZero();
      for (int a = J.rows[static_cast<std::size_t>(row)]; a < J.rows[static_cast<std::size_t>(row) + 1];
           ++a) {
        const int column = J.cols[static_cast<std::size_t>(a)];
        dense(column < camera_columns ? column : column - 6 * board) = J.values[static_cast<std::size_t>(a)];
      }
      H.selfadjointView<Eigen::Lower>().rankUpdate(dense);
      g += residuals[static_cast<std::size_t>(row)] * dense;
    }
    const Eigen::MatrixXd by_pose = H.bottomLeftCorner(6, camera_columns);
    const Eigen::LDLT<Eigen::MatrixXd, Eigen::Lower> pose(Eigen::MatrixXd(H.bottomRightCorner(6, 6)));
    Eigen::MatrixXd S = H.topLeftCorner(camera_columns, camera_columns).selfadjointView<Eigen::Lower>();
    S -= by_pose.transpose() * pose.solve(by_pose);
    pulls.push_back(
        {g.head(camera_columns) - by_pose.transpose() * pose.solve(g.tail(6)), S - S * covariance * S});
  }
  return pulls;
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
  options.apply_loss_function = true;  // a corner that is off does not count as one that contradicts
  ceres::CRSMatrix J;
  std::vector<double> residuals;
  if (!problem_.Evaluate(options, nullptr, &residuals, nullptr, &J))
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
  const auto count = static_cast<Eigen::Index>(columns.size());
  const Eigen::MatrixXd half = scale.head(count).asDiagonal() * eigen.eigenvectors().topRows(count) *
                               eigen.eigenvalues().cwiseSqrt().cwiseInverse().asDiagonal();
  const Eigen::MatrixXd covariance = half * half.transpose();
  // Noise that goes from pixel to pixel (a codec's, a denoiser's) or changes from view to view is more than
  // pixels say each for itself: boards contradict each other by more than that.
  std::vector<double> squares(columns.size(), 0), expected(columns.size(), 0);
  for (const BoardPull& p : PullsOfBoards(J, residuals, count, covariance)) {
    const Eigen::VectorXd moved = covariance * p.pull;
    const Eigen::MatrixXd moves = covariance * p.expects * covariance;
    for (std::size_t k = 0; k < columns.size(); ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      squares[k] += moved(i) * moved(i);
      expected[k] += moves(i, i);
    }
  }
  std::vector<double> widen(scene.cameras.size(), 0);  // of variances; sums first
  std::vector<int> numbers(scene.cameras.size(), 0);
  for (std::size_t k = 0; k < columns.size(); ++k) {
    if (!(expected[k] > 0)) continue;
    widen[columns[k].camera] += squares[k] / expected[k];
    ++numbers[columns[k].camera];
  }
  for (std::size_t c = 0; c < widen.size(); ++c)
    widen[c] = numbers[c] == 0 ? 1 : std::max(1.0, widen[c] / numbers[c]);
  for (std::size_t k = 0; k < columns.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(k);
    const double more = widen[columns[k].camera];
    const double sigma = std::sqrt(more * covariance(row, row));
    CameraDeviation& d = *deviations[columns[k].camera];
    for (std::size_t other = 0; other < columns.size(); ++other)
      if (columns[other].camera == columns[k].camera && columns[k].number < kLensNumbers &&
          columns[other].number < kLensNumbers)
        d.lens_covariance(columns[k].number, columns[other].number) =
            more * covariance(row, static_cast<Eigen::Index>(other));
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
