// SPDX-License-Identifier: Apache-2.0
#include "server/scene/object_stand.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mixstage {

Stand StandOf::operator()(const std::shared_ptr<const Mesh>& mesh, const Eigen::Affine3d& T_scene_object,
                          const Eigen::Vector3d& up) {
  const Eigen::Matrix3d& L = T_scene_object.linear();
  const Eigen::RowVector3d up_row = up.transpose() * L;
  const Eigen::Matrix3d gram = L.transpose() * L;
  if (mesh != mesh_ || !up_row.isApprox(up_row_, 1e-12) || !gram.isApprox(gram_, 1e-12)) {
    mesh_ = mesh;
    up_row_ = up_row;
    gram_ = gram;
    bounds_ = mesh->Bounds();
    const Eigen::Vector3d center = bounds_.center().cast<double>();
    lowest_ = std::numeric_limits<double>::infinity();
    double squared = 0;
    for (const Eigen::Vector3f& position : mesh->positions) {
      const Eigen::Vector3d offset = position.cast<double>() - center;
      const double height = up_row.dot(offset);
      lowest_ = std::min(lowest_, height);
      squared = std::max(squared, (L * offset).squaredNorm() - height * height);
    }
    radius_m_ = std::sqrt(squared);
  }
  return {T_scene_object * bounds_.center().cast<double>() + lowest_ * up, radius_m_, bounds_};
}

}  // namespace mixstage
