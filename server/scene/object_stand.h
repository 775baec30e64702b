// SPDX-License-Identifier: Apache-2.0
//
// Where an object touches the ground: what placing, dragging and dropping move, and what turning turns about.
#pragma once

#include <Eigen/Geometry>
#include <memory>

#include "server/scene/mesh.h"

namespace mixstage {

struct Stand {
  // Under the middle of the file's bounding box, at the height of the object's lowest vertex. Turning the
  // object about the vertical through it leaves it where it is.
  Eigen::Vector3d base = Eigen::Vector3d::Zero();
  double radius_m = 0;         // of the farthest vertex from that vertical
  Eigen::AlignedBox3f bounds;  // file coordinates
};

// The stand of one object through all its moves: vertices are looked at only when it is scaled or tilted.
class StandOf {
 public:
  // up: unit vector.
  Stand operator()(const std::shared_ptr<const Mesh>& mesh, const Eigen::Affine3d& T_scene_object,
                   const Eigen::Vector3d& up);

 private:
  std::shared_ptr<const Mesh> mesh_;
  // Heights and horizontal distances depend on these two of the linear part alone.
  Eigen::RowVector3d up_row_ = Eigen::RowVector3d::Zero();  // up^T L
  Eigen::Matrix3d gram_ = Eigen::Matrix3d::Zero();          // L^T L
  Eigen::AlignedBox3f bounds_;
  double lowest_ = 0;  // height of the lowest vertex above the center
  double radius_m_ = 0;
};

}  // namespace mixstage
