// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/tsai.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>

namespace mixstage {
namespace {

// A lens' axis and a pixel's shape are known this well without any calibration.
constexpr double kCentreGate = 0.02;  // of the width
constexpr double kScaleGate = 0.02;
constexpr double kFocalGate = 0.1;    // f known to no better than this: not a calibration
constexpr double kFlatness = 1e-6;    // thickness of a plane against its extent
constexpr double kNearlyFlat = 0.05;  // thinner than this: the coplanar start is tried as well

struct Start {
  Eigen::Matrix3d R;
  Eigen::Vector3d T;
  double f = 0, sx = 1;
};

// p_target = R (p_world - mean) / extent: axes by falling extent, so that a plane is z = 0.
struct TargetFrame {
  Eigen::Matrix3d R;
  Eigen::Vector3d mean;
  Eigen::Vector3d extents;  // rms along the axes, falling
  [[nodiscard]] Eigen::Vector3d To(const Eigen::Vector3d& p) const { return R * (p - mean) / extents[0]; }
};

TargetFrame FrameOf(std::span<const PointInPicture> points) {
  TargetFrame frame;
  frame.mean.setZero();
  for (const auto& point : points) frame.mean += point.p_world / static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const auto& point : points) {
    const Eigen::Vector3d d = point.p_world - frame.mean;
    scatter += d * d.transpose() / static_cast<double>(points.size());
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(scatter);
  frame.R = eigen.eigenvectors().rowwise().reverse().transpose();
  if (frame.R.determinant() < 0) frame.R.row(2) *= -1;
  frame.extents = eigen.eigenvalues().reverse().cwiseMax(0).cwiseSqrt();
  return frame;
}

// The vector that A maps nearest to 0; nothing when a second one does so as well.
std::optional<Eigen::VectorXd> NullVector(const Eigen::MatrixXd& A) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(A, Eigen::ComputeFullV);
  const Eigen::Index n = A.cols();
  if (svd.singularValues()[n - 2] <= 1e-9 * svd.singularValues()[0]) return std::nullopt;
  return Eigen::VectorXd(svd.matrixV().col(n - 1));
}

// Stage 2: f and T_z from y f - y_d T_z = y_d (r3 p), the same in x, with k1 = 0. False when the two cannot
// be told apart.
bool SolveFocal(const std::vector<Eigen::Vector3d>& p, const std::vector<Eigen::Vector2d>& d, Start& start) {
  Eigen::MatrixXd A(2 * static_cast<Eigen::Index>(p.size()), 2);
  Eigen::VectorXd b(A.rows());
  for (std::size_t i = 0; i < p.size(); ++i) {
    const Eigen::Vector3d q = start.R * p[i];
    for (Eigen::Index k = 0; k < 2; ++k) {
      const double seen = k == 0 ? d[i].x() / start.sx : d[i].y();
      const auto row = 2 * static_cast<Eigen::Index>(i) + k;
      A.row(row) << q[k] + start.T[k], -seen;
      b[row] = seen * q.z();
    }
  }
  const Eigen::Vector2d scale = A.colwise().norm();
  if (scale.minCoeff() <= 0) return false;
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(A * scale.cwiseInverse().asDiagonal(),
                                              Eigen::ComputeThinU | Eigen::ComputeThinV);
  if (svd.singularValues()[1] < 1e-9 * svd.singularValues()[0]) return false;
  const Eigen::Vector2d solved = scale.cwiseInverse().asDiagonal() * svd.solve(b);
  start.f = solved[0];
  start.T.z() = solved[1];
  return solved.allFinite();
}

// Stage 1, radial alignment: (x_d, y_d) is parallel to (x, y) whatever f, k1 and T_z are:
//   y_d (s_x r1 p + s_x T_x) - x_d (r2 p + T_y) = 0.
// Solved up to scale, where Tsai divides by T_y: his method fails for T_y = 0.
std::optional<Start> SolveSolid(const std::vector<Eigen::Vector3d>& p,
                                const std::vector<Eigen::Vector2d>& d) {
  Eigen::MatrixXd A(static_cast<Eigen::Index>(p.size()), 8);
  for (std::size_t i = 0; i < p.size(); ++i)
    A.row(static_cast<Eigen::Index>(i)) << d[i].y() * p[i].transpose(), d[i].y(),
        -d[i].x() * p[i].transpose(), -d[i].x();
  const auto null = NullVector(A);
  if (!null) return std::nullopt;
  Eigen::VectorXd a = *null;
  // The scale's sign: a point before the camera is seen on its own side of the axis.
  double side = 0;
  for (std::size_t i = 0; i < p.size(); ++i) side += d[i].y() * (a.segment<3>(4).dot(p[i]) + a[7]);
  a *= (side < 0 ? -1 : 1) / a.segment<3>(4).norm();
  Start start;
  start.sx = a.head<3>().norm();
  if (!a.allFinite() || start.sx < 1e-6) return std::nullopt;
  start.R.row(0) = a.head<3>().transpose() / start.sx;
  start.R.row(1) = a.segment<3>(4).transpose();
  start.R.row(2) = start.R.row(0).cross(start.R.row(1));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(start.R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  start.R = svd.matrixU() * svd.matrixV().transpose();
  if (start.R.determinant() < 0) return std::nullopt;
  start.T << a[3] / start.sx, a[7], 0;
  if (!SolveFocal(p, d, start) || start.f <= 0) return std::nullopt;
  return start;
}

// The same for z = 0, s_x = 1. The upper left 2x2 of a rotation has 1 as its larger singular value: the scale
// (Tsai's formula for T_y^2). r13 and r23 come with a common sign; f > 0 decides it.
std::optional<Start> SolvePlane(const std::vector<Eigen::Vector3d>& p,
                                const std::vector<Eigen::Vector2d>& d) {
  Eigen::MatrixXd A(static_cast<Eigen::Index>(p.size()), 6);
  for (std::size_t i = 0; i < p.size(); ++i)
    A.row(static_cast<Eigen::Index>(i)) << d[i].y() * p[i].head<2>().transpose(), d[i].y(),
        -d[i].x() * p[i].head<2>().transpose(), -d[i].x();
  const auto null = NullVector(A);
  if (!null) return std::nullopt;
  Eigen::VectorXd a = *null;
  double side = 0;
  for (std::size_t i = 0; i < p.size(); ++i) side += d[i].y() * (a.segment<2>(3).dot(p[i].head<2>()) + a[5]);
  Eigen::Matrix2d C;
  C << a[0], a[1], a[3], a[4];
  a *= (side < 0 ? -1 : 1) / Eigen::JacobiSVD<Eigen::Matrix2d>(C).singularValues()[0];
  if (!a.allFinite()) return std::nullopt;
  const double r13 = std::sqrt(std::max(0.0, 1 - a[0] * a[0] - a[1] * a[1]));
  const double r23 =
      std::copysign(std::sqrt(std::max(0.0, 1 - a[3] * a[3] - a[4] * a[4])), -(a[0] * a[3] + a[1] * a[4]));
  for (const double sign : {1.0, -1.0}) {
    Start start;
    start.R.row(0) << a[0], a[1], sign * r13;
    start.R.row(1) << a[3], a[4], sign * r23;
    start.R.row(2) = start.R.row(0).cross(start.R.row(1));
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(start.R, Eigen::ComputeFullU | Eigen::ComputeFullV);
    start.R = svd.matrixU() * svd.matrixV().transpose();
    start.T << a[2], a[5], 0;
    if (start.R.determinant() > 0 && SolveFocal(p, d, start) && start.f > 0 && start.T.z() > 0) return start;
  }
  return std::nullopt;
}

struct PointResidual {
  Eigen::Vector3d p;
  Eigen::Vector2d pixel;

  // lens: f, k1, as the linear stage leaves them; the rest joins later. f as its logarithm stays positive.
  template <typename Number>
  bool operator()(const Number* log_f, const Number* k1, const Number* centre, const Number* sx,
                  const Number* rotation, const Number* T, Number* residual) const {
    const Eigen::Matrix<Number, 3, 1> q =
        Eigen::Map<const Eigen::Quaternion<Number>>(rotation) * p.cast<Number>().eval();
    const Number z = q[2] + T[2];
    if (z < 1e-9) return false;
    const Number x = (q[0] + T[0]) / z, y = (q[1] + T[1]) / z;
    const Number fg = exp(log_f[0]) * (1.0 + k1[0] * (x * x + y * y));
    residual[0] = sx[0] * fg * x + centre[0] - pixel.x();
    residual[1] = fg * y + centre[1] - pixel.y();
    return true;
  }
};

// The refinement's state, in the target's frame and scale.
struct Fit {
  double log_f = 0, k1 = 0, sx = 1;
  Eigen::Vector2d centre;
  Eigen::Quaterniond rotation;
  Eigen::Vector3d T;
  double sum_squares = std::numeric_limits<double>::infinity();
  Eigen::Matrix<double, 11, 1> sd;  // log f, k1, cx, cy, sx, rotation (tangent), T; 0 where held
};

struct Free {
  bool pose = true, centre = true, sx = true;
};

// False when the solver fails or the covariance does not exist.
bool Refine(const std::vector<Eigen::Vector3d>& p, std::span<const PointInPicture> points, const Free& free,
            Fit& fit) {
  ceres::Problem::Options options;
  ceres::Problem problem(options);
  problem.AddParameterBlock(&fit.log_f, 1);
  problem.AddParameterBlock(&fit.k1, 1);
  problem.AddParameterBlock(fit.centre.data(), 2);
  problem.AddParameterBlock(&fit.sx, 1);
  problem.AddParameterBlock(fit.rotation.coeffs().data(), 4, new ceres::EigenQuaternionManifold);
  problem.AddParameterBlock(fit.T.data(), 3, free.pose ? nullptr : new ceres::SubsetManifold(3, {0, 1}));
  for (std::size_t i = 0; i < p.size(); ++i)
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PointResidual, 2, 1, 1, 2, 1, 4, 3>(
                                 new PointResidual{p[i], points[i].pixel}),
                             nullptr, &fit.log_f, &fit.k1, fit.centre.data(), &fit.sx,
                             fit.rotation.coeffs().data(), fit.T.data());
  if (!free.centre) problem.SetParameterBlockConstant(fit.centre.data());
  if (!free.sx) problem.SetParameterBlockConstant(&fit.sx);
  if (!free.pose) problem.SetParameterBlockConstant(fit.rotation.coeffs().data());
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_QR;
  solver.max_num_iterations = 200;
  solver.function_tolerance = 1e-14;
  solver.gradient_tolerance = 1e-12;
  solver.parameter_tolerance = 1e-12;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  if (!summary.IsSolutionUsable()) return false;
  fit.sum_squares = 2 * summary.final_cost;
  fit.sd.setZero();
  if (!free.pose) return true;  // an intermediate fit
  const double freedom = 2.0 * static_cast<double>(p.size()) - 8 - (free.centre ? 2 : 0) - (free.sx ? 1 : 0);
  const double noise = std::sqrt(fit.sum_squares / freedom);
  ceres::Covariance::Options how;
  how.algorithm_type = ceres::DENSE_SVD;
  how.min_reciprocal_condition_number = 0;  // what is not determined has a huge deviation: the gates see it
  ceres::Covariance covariance(how);
  std::vector<const double*> blocks{&fit.log_f, &fit.k1, fit.rotation.coeffs().data(), fit.T.data()};
  if (free.centre) blocks.push_back(fit.centre.data());
  if (free.sx) blocks.push_back(&fit.sx);
  std::vector<std::pair<const double*, const double*>> pairs;
  for (const double* block : blocks) pairs.emplace_back(block, block);
  if (!covariance.Compute(pairs, &problem)) return false;
  auto put = [&](const double* block, Eigen::Index size, Eigen::Index at) {
    Eigen::MatrixXd variance(size, size);
    covariance.GetCovarianceBlockInTangentSpace(block, block, variance.data());
    fit.sd.segment(at, size) = noise * variance.diagonal().cwiseMax(0).cwiseSqrt();
  };
  put(&fit.log_f, 1, 0);
  put(&fit.k1, 1, 1);
  if (free.centre) put(fit.centre.data(), 2, 2);
  if (free.sx) put(&fit.sx, 1, 4);
  put(fit.rotation.coeffs().data(), 3, 5);
  put(fit.T.data(), 3, 8);
  return fit.sd.allFinite();
}

}  // namespace

Result<TsaiCalibration> CalibrateTsai(std::span<const PointInPicture> points, int width, int height,
                                      std::optional<Eigen::Vector2d> centre_px) {
  if (width < 1 || height < 1) return Fail(ErrorCode::kBadInput, "the picture has no size");
  const Eigen::Vector2d centre = centre_px.value_or(Eigen::Vector2d((width - 1) / 2.0, (height - 1) / 2.0));
  if (!centre.allFinite()) return Fail(ErrorCode::kBadInput, "the picture's centre is not finite");
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!points[i].p_world.allFinite() || !points[i].pixel.allFinite())
      return Fail(ErrorCode::kBadInput, "point " + std::to_string(i) + " is not finite");
  if (points.size() < 6)
    return Fail(ErrorCode::kBadInput,
                std::to_string(points.size()) + " points, at least 6 in a plane or 8 elsewhere are needed");
  const TargetFrame frame = FrameOf(points);
  if (!(frame.extents[1] > kFlatness * frame.extents[0]))
    return Fail(ErrorCode::kBadInput, "the points lie in a line");
  const bool coplanar = frame.extents[2] <= kFlatness * frame.extents[0];
  if (!coplanar && points.size() < 8)
    return Fail(ErrorCode::kBadInput, std::to_string(points.size()) +
                                          " points that are not in a plane, at "
                                          "least 8 are needed");

  std::vector<Eigen::Vector3d> p;
  std::vector<Eigen::Vector2d> d;
  for (const auto& point : points) {
    p.push_back(frame.To(point.p_world));
    d.push_back(point.pixel - centre);
  }
  std::vector<Start> starts;
  if (!coplanar)
    if (auto start = SolveSolid(p, d)) starts.push_back(*start);
  if (frame.extents[2] <= kNearlyFlat * frame.extents[0])
    if (auto start = SolvePlane(p, d)) starts.push_back(*start);
  const std::string inseparable =
      "f and T_z cannot be told apart: the points lie in a plane nearly parallel to the picture; tilt it";
  if (starts.empty())
    return Fail(
        ErrorCode::kQualityGate,
        coplanar ? inseparable : "no camera sees the points there: are pixels and points in the same order?");

  Fit best;
  for (const Start& start : starts) {
    Fit fit;
    fit.log_f = std::log(start.f);
    fit.sx = start.sx;
    fit.centre = centre;
    fit.rotation = Eigen::Quaterniond(start.R);
    fit.T = start.T;
    // Stage 2's end: f, k1 and T_z alone; then everything. s_x joins where there is depth.
    if (!Refine(p, points, {.pose = false, .centre = false, .sx = false}, fit)) continue;
    if (!Refine(p, points, {.centre = false, .sx = !coplanar}, fit)) continue;
    if (fit.sum_squares < best.sum_squares) best = fit;
  }
  if (!std::isfinite(best.sum_squares)) return Fail(ErrorCode::kQualityGate, inseparable);

  TsaiCalibration result;
  result.coplanar = coplanar;
  Free free{.sx = !coplanar};
  if (coplanar) result.held.emplace_back("sx at 1: the points lie in a plane");
  if (!coplanar && best.sd[4] > kScaleGate) {
    free.sx = false;
    best.sx = 1;
    result.held.emplace_back("sx at 1: the points have too little depth");
  }
  const Fit before = best;
  if (!Refine(p, points, free, best) || best.sd.segment<2>(2).maxCoeff() > kCentreGate * width) {
    best = before;
    free.centre = false;
    result.held.emplace_back(
        "cx, cy at the start's: the points determine them to no better than 2 % of the width");
    if (!Refine(p, points, free, best)) return Fail(ErrorCode::kQualityGate, inseparable);
  }
  if (best.sd[0] > kFocalGate) return Fail(ErrorCode::kQualityGate, inseparable);

  const double f = std::exp(best.log_f), scale = frame.extents[0];
  result.camera = {.width = width,
                   .height = height,
                   .fx = best.sx * f,
                   .fy = f,
                   .cx = best.centre.x(),
                   .cy = best.centre.y(),
                   .k1 = best.k1};
  result.sx = best.sx;
  result.rms_px = std::sqrt(best.sum_squares / static_cast<double>(points.size()));
  const Eigen::Matrix3d R = best.rotation.normalized().toRotationMatrix();
  result.T_camera_world.linear() = R * frame.R;
  result.T_camera_world.translation() = scale * best.T - result.T_camera_world.linear() * frame.mean;
  result.f_sd_px = f * best.sd[0];
  result.k1_sd = best.sd[1];
  result.cx_sd_px = best.sd[2];
  result.cy_sd_px = best.sd[3];
  result.sx_sd = best.sd[4];
  result.rotation_sd_rad = 2 * best.sd.segment<3>(5);  // the quaternion's tangent is half the angle
  result.translation_sd = scale * best.sd.segment<3>(8);
  return result;
}

}  // namespace mixstage
