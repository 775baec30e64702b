// SPDX-License-Identifier: Apache-2.0
#include "proto/geometry/frames.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace mixstage {
namespace {

Status CheckFiniteAffine(const std::array<double, 16>& m) {
  if (!std::all_of(m.begin(), m.end(), [](double v) { return std::isfinite(v); })) {
    return Fail(ErrorCode::kBadInput, "has a number that is not finite");
  }
  if (std::abs(m[12]) + std::abs(m[13]) + std::abs(m[14]) + std::abs(m[15] - 1.0) > 1e-9) {
    return Fail(ErrorCode::kBadInput, "its last row is not 0 0 0 1 (16 numbers, row-major, are expected)");
  }
  return {};
}

}  // namespace

Result<RigidTransform> RigidFromRowMajor(const std::array<double, 16>& m) {
  if (auto ok = CheckFiniteAffine(m); !ok) return tl::unexpected(ok.error());
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(m.data());
  const Eigen::Matrix3d R = matrix.topLeftCorner<3, 3>();
  const double skew = (R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (skew > 1e-3 || R.determinant() < 0.0) {
    return Fail(ErrorCode::kBadInput, "is not a rigid transform (its 3x3 part is no rotation)");
  }
  RigidTransform T = RigidTransform::Identity();
  T.linear() = Eigen::Quaterniond(R).normalized().toRotationMatrix();
  T.translation() = matrix.topRightCorner<3, 1>();
  return T;
}

Result<Eigen::Affine3d> AffineFromRowMajor(const std::array<double, 16>& m) {
  if (auto ok = CheckFiniteAffine(m); !ok) return tl::unexpected(ok.error());
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(m.data());
  if (std::abs(matrix.topLeftCorner<3, 3>().determinant()) < 1e-12) {
    return Fail(ErrorCode::kBadInput, "squeezes the object flat (its 3x3 part is singular)");
  }
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.matrix() = matrix;
  return T;
}

Result<RigidTransform> RigidFromTum(const std::array<double, 7>& n) {
  if (!std::all_of(n.begin(), n.end(), [](double v) { return std::isfinite(v); })) {
    return Fail(ErrorCode::kBadInput, "has a number that is not finite");
  }
  const Eigen::Quaterniond q(n[6], n[3], n[4], n[5]);
  if (std::abs(q.norm() - 1.0) > 1e-2) return Fail(ErrorCode::kBadInput, "its quaternion is not of length 1");
  RigidTransform T = RigidTransform::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() = Eigen::Vector3d(n[0], n[1], n[2]);
  return T;
}

std::string TumLine(double timestamp_s, const RigidTransform& T) {
  const Eigen::Quaterniond q(T.linear());
  const Eigen::Vector3d t = T.translation();
  char line[200];
  std::snprintf(line, sizeof line, "%.6f %.6f %.6f %.6f %.7f %.7f %.7f %.7f", timestamp_s, t.x(), t.y(),
                t.z(), q.x(), q.y(), q.z(), q.w());
  return line;
}

}  // namespace mixstage
