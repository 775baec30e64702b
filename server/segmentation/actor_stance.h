// SPDX-License-Identifier: Apache-2.0
//
// Where a camera stands over the floor, by the actor in front of it, where nothing else says it (piVE 5): the
// principal axis of his points is perpendicular to the floor, and his feet are on it.
#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"

namespace mixstage {

class ActorStance {
 public:
  static constexpr int kMostFrames = 60;

  explicit ActorStance(const PinholeCamera& color);

  // actor_depth_m [Half(h) x Half(w)] z of the actor, 0 = not he (ActorSurface). Counts only where he is seen
  // whole and upright: longer than wide, off the picture's border. The first kMostFrames of those decide, so
  // that a later bow or jump is one.
  void See(ImageView<const float> actor_depth_m);

  // z up through the floor under the camera, x along its axis; nothing until he was seen once.
  [[nodiscard]] const std::optional<RigidTransform>& T_world_color() const { return T_world_color_; }

 private:
  struct Line {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero(), direction = Eigen::Vector3d::Zero();
  };
  bool Collect(ImageView<const float> actor_depth_m);
  [[nodiscard]] std::optional<Line> PrincipalAxis() const;

  cv::Mat2f half_rays_;
  std::vector<Eigen::Vector3d> points_;
  std::vector<Eigen::Vector3d> ups_;  // one a frame that counted, camera's frame
  std::vector<double> heights_m_;     // of the camera above his feet
  std::optional<RigidTransform> T_world_color_;
};

// The pose of a camera from what is up for it and how high it hangs: z up, origin on the floor under it, x
// along its axis.
[[nodiscard]] RigidTransform PoseOver(const Eigen::Vector3d& up_in_camera, double height_m);

}  // namespace mixstage
