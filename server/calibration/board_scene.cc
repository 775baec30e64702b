// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/board_scene.h"

namespace mixstage {

PoseNumbers NumbersOf(const RigidTransform& T) {
  const Eigen::AngleAxisd turn(T.linear());
  const Eigen::Vector3d w = turn.angle() * turn.axis();
  const Eigen::Vector3d t = T.translation();
  return {w.x(), w.y(), w.z(), t.x(), t.y(), t.z()};
}

RigidTransform TransformOf(const PoseNumbers& n) {
  RigidTransform T = RigidTransform::Identity();
  const Eigen::Vector3d w(n[0], n[1], n[2]);
  if (w.norm() > 0) T.linear() = Eigen::AngleAxisd(w.norm(), w.normalized()).toRotationMatrix();
  T.translation() = Eigen::Vector3d(n[3], n[4], n[5]);
  return T;
}

std::vector<Eigen::Vector2d> CornerResiduals(const BoardScene& scene, const SceneSighting& s) {
  const Board& board = scene.boards[scene.placements[s.placement].board];
  const RigidTransform T_camera_board = scene.TCameraBoard(s.camera, s.placement);
  std::vector<Eigen::Vector2d> residuals;
  for (std::size_t i = 0; i < s.corners.corners.size(); ++i) {
    const auto p = scene.cameras[s.camera].lens.Project(T_camera_board * board.Corner(s.corners.corners[i]));
    residuals.push_back(p ? Eigen::Vector2d(s.corners.pixels[i] - *p) : Eigen::Vector2d(1e3, 1e3));
  }
  return residuals;
}

}  // namespace mixstage
