// SPDX-License-Identifier: Apache-2.0
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <vector>

#include "server/calibration/hand_eye_adjustment.h"

namespace mixstage {

RelativeDeviation DeviationBetween(const HandEyeAdjustment& problem,
                                   const std::vector<Eigen::Vector2d>& positions) {
  // The head with its numbers moved a little along one of them, or as it is.
  const auto poses = [&](int number, double step) {
    HandEyeAdjustment moved;
    moved.mechanism = problem.mechanism;
    moved.T_hand_color = problem.T_hand_color;
    if (number < 4)
      moved.mechanism[number] += step;
    else if (number < 7)
      moved.T_hand_color.linear() =
          Eigen::AngleAxisd(step, Eigen::Vector3d::Unit(number - 4)) * moved.T_hand_color.linear();
    else
      moved.T_hand_color.translation()[number - 7] += step;
    std::vector<RigidTransform> list;
    for (const Eigen::Vector2d& at : positions) {
      HandEyeAdjustment::View view;
      view.pan_rad = at[0];
      view.tilt_rad = at[1];
      list.push_back(moved.TBaseColor(view));
    }
    return list;
  };
  constexpr double kStep = 1e-5;
  const auto as_is = poses(0, 0);
  std::array<std::vector<RigidTransform>, 10> moved;
  for (int number = 0; number < 10; ++number) moved[static_cast<std::size_t>(number)] = poses(number, kStep);
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double pairs = 0;
  for (std::size_t i = 0; i < positions.size(); ++i)
    for (std::size_t k = 0; k < i; ++k, ++pairs) {
      const RigidTransform back = (as_is[i].inverse() * as_is[k]).inverse();
      Eigen::Matrix<double, 6, 10> J;
      for (std::size_t number = 0; number < 10; ++number) {
        const RigidTransform off = back * (moved[number][i].inverse() * moved[number][k]);
        const Eigen::Matrix3d& R = off.linear();
        J.col(static_cast<Eigen::Index>(number))
            << Eigen::Vector3d(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1)) / 2,
            off.translation();
      }
      const Eigen::Matrix<double, 6, 1> variances =
          (J * problem.covariance * J.transpose()).diagonal() / (kStep * kStep);
      sum += Eigen::Vector2d(variances.head<3>().sum(), variances.tail<3>().sum());
    }
  if (pairs > 0) sum /= pairs;
  return {std::sqrt(sum[0]), std::sqrt(sum[1])};
}

}  // namespace mixstage
