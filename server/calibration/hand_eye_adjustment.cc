// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/hand_eye_adjustment.h"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <map>

#include "proto/base/median.h"

#include "server/calibration/hand_eye_residuals.h"

namespace mixstage {
namespace {

using namespace hand_eye;

constexpr double kLossScale = 3;        // sigmas
constexpr double kLeastNoisePx = 0.01;  // noise that vanishes would be certainty
constexpr double kLeastEncoderNoise = 1e-5;
constexpr int kRounds = 12;

ceres::CostFunction* Expect(const Eigen::VectorXd& mean, const Eigen::VectorXd& sd) {
  auto* cost = new ceres::DynamicAutoDiffCostFunction<Expectation, 6>(new Expectation{mean, sd});
  cost->AddParameterBlock(static_cast<int>(mean.size()));
  cost->SetNumResiduals(static_cast<int>(mean.size()));
  return cost;
}

ceres::CostFunction* ExpectLens(const HandEyeAdjustment::Camera& camera, const std::vector<int>& known) {
  const auto n = static_cast<Eigen::Index>(known.size());
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < n; ++k)
      covariance(i, k) =
          camera.lens_covariance(known[static_cast<std::size_t>(i)], known[static_cast<std::size_t>(k)]);
  auto* cost = new ceres::DynamicAutoDiffCostFunction<LensExpectation, kLensNumbers>(
      new LensExpectation{camera.lens_expected, known, covariance.llt().matrixL()});
  cost->AddParameterBlock(kLensNumbers);
  cost->SetNumResiduals(static_cast<int>(n));
  return cost;
}

struct Blocks {
  Eigen::Quaterniond q;
  Eigen::Vector3d t;
  explicit Blocks(const RigidTransform& T) : q(T.linear()), t(T.translation()) {}
  [[nodiscard]] RigidTransform Transform() const {
    return RigidTransform(Eigen::Translation3d(t) * q.normalized());
  }
};

RigidTransform Transform(const Rigid<double>& rigid) {
  return RigidTransform(Eigen::Translation3d(rigid.t) * rigid.q.normalized());
}

// One solution at the present noise; afterwards covariance of everything, noise of pixels and of encoders.
template <typename Motion>
class Solution {
 public:
  Solution(HandEyeAdjustment& problem, OutlierLoss loss, const Blocks& mount_start)
      : p_(problem), loss_(loss), mount_(problem.T_hand_color) {
    for (const RigidTransform& T : p_.T_base_board) boards_.emplace_back(T);
    Build(mount_start);
  }

  bool Solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-8;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    if (!summary.IsSolutionUsable()) return false;
    p_.T_hand_color = mount_.Transform();
    for (std::size_t b = 0; b < boards_.size(); ++b) p_.T_base_board[b] = boards_[b].Transform();
    return Invert();
  }

  void EstimateNoise() {
    std::vector<std::vector<double>> off(p_.cameras.size());
    for (auto& sighting : p_.sightings) {
      Compare(sighting);
      if (!sighting.used) continue;
      for (const Eigen::Vector2d& d : sighting.off_px) {
        off[sighting.camera].push_back(std::abs(d.x()));
        off[sighting.camera].push_back(std::abs(d.y()));
      }
    }
    for (std::size_t c = 0; c < off.size(); ++c)
      if (!off[c].empty()) p_.cameras[c].noise_px = std::max(kLeastNoisePx, 1.4826 * Median(off[c]));
    // The corrections' own spread: what was found plus what the pictures leave uncertain of it.
    std::array<std::vector<double>, 2> squares;
    for (auto& view : p_.views) {
      if (!view.used) continue;
      const Eigen::Index at = place_.at(view.correction.data());
      for (int k = 0; k < Motion::kCorrection; ++k)
        squares[static_cast<std::size_t>(2 * k / Motion::kCorrection)].push_back(
            view.correction[k] * view.correction[k] + all_(at + k, at + k));
    }
    for (std::size_t group = 0; group < 2; ++group) {
      double mean = 0;
      for (const double s : squares[group]) mean += s / static_cast<double>(squares[group].size());
      // With views in doubt among them the median stands for the mean (of a chi-squared: 0.4549).
      if (loss_ == OutlierLoss::kCauchy) mean = Median(squares[group]) / 0.4549;
      p_.encoder_noise[static_cast<Eigen::Index>(group)] = std::max(kLeastEncoderNoise, std::sqrt(mean));
    }
  }

 private:
  static Motion MotionOf(const HandEyeAdjustment::View& view) {
    if constexpr (Motion::kMechanism == 4)
      return {view.pan_rad, view.tilt_rad};
    else
      return {view.T_base_hand};
  }

  void Build(const Blocks& mount_start) {
    auto add = [&](double* block, int size, ceres::Manifold* manifold = nullptr) {
      problem_.AddParameterBlock(block, size, manifold);
      order_.push_back(block);
    };
    if (Motion::kMechanism == 4) {
      add(p_.mechanism.data(), 4);
      problem_.AddResidualBlock(Expect(p_.mechanism_expected, p_.mechanism_sd), nullptr, p_.mechanism.data());
    } else {
      problem_.AddParameterBlock(p_.mechanism.data(), 1);
      problem_.SetParameterBlockConstant(p_.mechanism.data());
    }
    add(mount_.q.coeffs().data(), 4, new ceres::EigenQuaternionManifold);
    add(mount_.t.data(), 3);
    problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<RotationExpectation, 3, 4>(
                                  new RotationExpectation{mount_start.q, p_.mount_sd_rad}),
                              nullptr, mount_.q.coeffs().data());
    problem_.AddResidualBlock(Expect(mount_start.t, Eigen::Vector3d::Constant(p_.mount_sd_m)), nullptr,
                              mount_.t.data());
    for (auto& view : p_.views) {
      if (!view.used) continue;
      add(view.correction.data(), Motion::kCorrection);
      Eigen::VectorXd sd(Motion::kCorrection);
      for (Eigen::Index k = 0; k < sd.size(); ++k) sd[k] = p_.encoder_noise[2 * k / sd.size()];
      problem_.AddResidualBlock(Expect(Eigen::VectorXd::Zero(sd.size()), sd),
                                loss_ == OutlierLoss::kCauchy ? new ceres::CauchyLoss(kLossScale) : nullptr,
                                view.correction.data());
    }
    for (std::size_t c = 0; c < p_.cameras.size(); ++c) {
      auto& camera = p_.cameras[c];
      const bool looks = std::any_of(p_.sightings.begin(), p_.sightings.end(),
                                     [&](const auto& s) { return s.used && s.camera == c; });
      if (!looks) continue;
      double* numbers = camera.lens.numbers.data();
      std::vector<int> known, held;
      for (int i = 0; i < kLensNumbers; ++i) (camera.lens_covariance(i, i) > 0 ? known : held).push_back(i);
      if (known.empty()) {
        problem_.AddParameterBlock(numbers, kLensNumbers);
        problem_.SetParameterBlockConstant(numbers);
        continue;
      }
      add(numbers, kLensNumbers, new ceres::SubsetManifold(kLensNumbers, held));
      problem_.AddResidualBlock(ExpectLens(camera, known), nullptr, numbers);
    }
    std::vector<bool> board_seen(boards_.size(), false);
    for (const auto& sighting : p_.sightings) {
      if (!sighting.used) continue;
      Blocks& board = boards_[sighting.board];
      if (!board_seen[sighting.board]) {
        add(board.q.coeffs().data(), 4, new ceres::EigenQuaternionManifold);
        add(board.t.data(), 3);
        board_seen[sighting.board] = true;
      }
      auto& view = p_.views[sighting.view];
      weights_.push_back(CornerWeights(sighting));
      const auto residuals = static_cast<int>(2 * sighting.pixels.size());
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<SightingResidual<Motion>, ceres::DYNAMIC, Motion::kMechanism,
                                          Motion::kCorrection, 4, 3, 4, 3, kLensNumbers>(
              new SightingResidual<Motion>{MotionOf(view), &p_.cameras[sighting.camera], &sighting,
                                           &weights_.back()},
              residuals),
          loss_ == OutlierLoss::kCauchy ? new ceres::CauchyLoss(kLossScale * std::sqrt(residuals)) : nullptr,
          p_.mechanism.data(), view.correction.data(), mount_.q.coeffs().data(), mount_.t.data(),
          board.q.coeffs().data(), board.t.data(), p_.cameras[sighting.camera].lens.numbers.data());
    }
  }

  // Huber's weights for the offsets of the last solution; 1 before the first.
  std::vector<double> CornerWeights(const HandEyeAdjustment::Sighting& sighting) const {
    std::vector<double> weights(sighting.pixels.size(), 1);
    const double limit = kLossScale * std::sqrt(2.0) * p_.cameras[sighting.camera].noise_px;
    for (std::size_t i = 0; i < sighting.off_px.size(); ++i)
      if (const double off = sighting.off_px[i].norm(); off > limit) weights[i] = std::sqrt(limit / off);
    return weights;
  }

  // all_ = (J^T J)^-1 of everything; the expectations make it regular whatever the views leave open.
  bool Invert() {
    ceres::Problem::EvaluateOptions options;
    options.parameter_blocks = order_;
    ceres::CRSMatrix J;
    if (!problem_.Evaluate(options, nullptr, nullptr, nullptr, &J)) return false;
    Eigen::Index columns = 0;
    for (double* block : order_) {
      place_[block] = columns;
      columns += problem_.ParameterBlockTangentSize(block);
    }
    Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(columns, columns);
    for (int row = 0; row < J.num_rows; ++row) {
      const auto begin = static_cast<std::size_t>(J.rows[static_cast<std::size_t>(row)]);
      const auto end = static_cast<std::size_t>(J.rows[static_cast<std::size_t>(row) + 1]);
      for (std::size_t i = begin; i < end; ++i)
        for (std::size_t k = begin; k < end; ++k) normal(J.cols[i], J.cols[k]) += J.values[i] * J.values[k];
    }
    const Eigen::VectorXd scale = normal.diagonal().cwiseSqrt().cwiseInverse();
    if (!scale.allFinite()) return false;
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(scale.asDiagonal() * normal * scale.asDiagonal());
    if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
    all_ = scale.asDiagonal() * ldlt.solve(Eigen::MatrixXd::Identity(columns, columns)) * scale.asDiagonal();
    if (!all_.allFinite()) return false;
    const Eigen::Index own = Motion::kMechanism == 4 ? 10 : 6;
    // The quaternion's tangent is half the angle.
    Eigen::VectorXd units = Eigen::VectorXd::Ones(own);
    units.segment(own - 6, 3).setConstant(2);
    p_.covariance.setZero();
    p_.covariance.bottomRightCorner(own, own) =
        units.asDiagonal() * all_.topLeftCorner(own, own) * units.asDiagonal();
    return true;
  }

  void Compare(HandEyeAdjustment::Sighting& sighting) const {
    const auto& camera = p_.cameras[sighting.camera];
    const RigidTransform T_camera_board = camera.T_camera_color *
                                          p_.TBaseColor(p_.views[sighting.view]).inverse() *
                                          p_.T_base_board[sighting.board];
    double sum = 0;
    sighting.off_px.clear();
    for (std::size_t i = 0; i < sighting.pixels.size(); ++i) {
      const Eigen::Vector3d p = T_camera_board * sighting.p_board[i];
      sighting.off_px.push_back(Pixel<double>(camera.lens.kind, camera.lens.numbers.data(), p) -
                                sighting.pixels[i]);
      sum += sighting.off_px.back().squaredNorm();
    }
    sighting.rms_px = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, sighting.pixels.size())));
  }

  HandEyeAdjustment& p_;
  const OutlierLoss loss_;
  Blocks mount_;
  std::vector<Blocks> boards_;
  std::deque<std::vector<double>> weights_;  // of the corners, a list per sighting
  ceres::Problem problem_;
  std::vector<double*> order_;                   // parameter blocks: mechanism, mount first
  std::map<const double*, Eigen::Index> place_;  // of a block's columns
  Eigen::MatrixXd all_;
};

template <typename Motion>
Status AdjustAs(HandEyeAdjustment& problem, OutlierLoss loss) {
  const Blocks mount_start(problem.T_hand_color);
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::Vector2d before = problem.encoder_noise;
    Solution<Motion> solution(problem, loss, mount_start);
    if (!solution.Solve()) return Fail(ErrorCode::kQualityGate, "the hand-eye adjustment finds no solution");
    solution.EstimateNoise();
    // Once views are out the estimate is worth more rounds.
    const double settled = loss == OutlierLoss::kCauchy ? 0.1 : 0.01;
    if (((problem.encoder_noise - before).cwiseAbs().array() < settled * before.array()).all()) break;
  }
  return {};
}

}  // namespace

RigidTransform HandEyeAdjustment::TBaseColor(const View& view) const {
  const Rigid<double> T_base_hand =
      kind == HeadKind::kPanTilt
          ? PanTiltMotion{view.pan_rad, view.tilt_rad}(mechanism.data(), view.correction.data())
          : RobotMotion{view.T_base_hand}(mechanism.data(), view.correction.data());
  return Transform(T_base_hand) * T_hand_color;
}

Status Adjust(HandEyeAdjustment& problem, OutlierLoss loss) {
  return problem.kind == HeadKind::kPanTilt ? AdjustAs<PanTiltMotion>(problem, loss)
                                            : AdjustAs<RobotMotion>(problem, loss);
}

}  // namespace mixstage
