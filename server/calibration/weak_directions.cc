// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/weak_directions.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "proto/base/text.h"

namespace mixstage {

std::vector<std::string> WeakDirections(const Eigen::MatrixXd& covariance, const std::vector<Direction>& of) {
  const auto n = static_cast<Eigen::Index>(of.size());
  Eigen::MatrixXd scaled = covariance;
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < n; ++k)
      scaled(i, k) /= of[static_cast<std::size_t>(i)].unit * of[static_cast<std::size_t>(k)].unit;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  std::vector<std::string> weak;
  for (Eigen::Index e = n - 1; e >= 0 && eigen.eigenvalues()[e] > 1; --e) {
    const Eigen::VectorXd v = eigen.eigenvectors().col(e);
    std::vector<Eigen::Index> parts;
    for (Eigen::Index i = 0; i < n; ++i)
      if (std::abs(v[i]) > 0.35 * v.cwiseAbs().maxCoeff()) parts.push_back(i);
    std::sort(parts.begin(), parts.end(),
              [&](Eigen::Index a, Eigen::Index b) { return std::abs(v[a]) > std::abs(v[b]); });
    std::string words;
    for (const Eigen::Index i : parts) {
      const Direction& d = of[static_cast<std::size_t>(i)];
      words += (words.empty() ? "" : " traded against ") + d.name + " (+-" +
               Text(d.text, std::sqrt(covariance(i, i)) * d.per_unit) + ")";
    }
    weak.push_back(words);
  }
  return weak;
}

}  // namespace mixstage
