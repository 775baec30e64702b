// SPDX-License-Identifier: Apache-2.0
//
// The actor as something that pushes (piVE 4's third kind of object; algorithms 8): his depth surface as
// small balls that are followed from picture to picture. Each ball takes the points of the new surface that
// are nearest to where its motion would have brought it, and moves to their middle: so it keeps its piece of
// him, has his velocity, and never jumps.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <span>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/physics/physics.h"

namespace mixstage {

struct ActorColliderConfig {
  double radius_m = 0.04;   // of a ball: it lies behind the surface and touches it
  double spacing_m = 0.06;  // of balls on the surface
  double fastest_m_s = 8;   // no ball is faster
  std::size_t most = 400;   // balls
};

// One thread at a time.
class ActorCollider {
 public:
  explicit ActorCollider(const PinholeCamera& color, const ActorColliderConfig& config = {});

  // actor_depth_m  [Half(h) x Half(w)]  z of the actor in the colour camera, 0 = none (ActorSurface)
  // T_scene_color  where the colour camera is
  // reach          boxes in the scene outside of which the actor does not matter (Physics::ActorReach), to
  //                half a metre
  // t_us           of the picture
  // Balls in the order of their ids. A pure function of the calls since the last gap of 150 ms or jump back.
  std::span<const ActorBall> Run(ImageView<const float> actor_depth_m, const RigidTransform& T_scene_color,
                                 std::span<const Eigen::AlignedBox3d> reach, std::int64_t t_us);

 private:
  struct Track {
    Eigen::Vector3d at = Eigen::Vector3d::Zero();  // middle of its piece of the surface, scene frame
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
    int missed = 0;  // pictures without points
    // Of the current Run.
    Eigen::Vector3d expected = Eigen::Vector3d::Zero(), sum = Eigen::Vector3d::Zero();
    Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();
    int points = 0;
  };

  void Gather(ImageView<const float> actor_depth_m, const RigidTransform& T_scene_color,
              std::span<const Eigen::AlignedBox3d> reach);
  void Assign();
  void Move(const Eigen::Vector3d& camera, double dt_s);
  void Seed(const Eigen::Vector3d& camera);

  ActorColliderConfig config_;
  int step_px_ = 3;  // of the half-size picture
  int columns_ = 0, rows_ = 0;
  std::vector<Eigen::Vector2f> rays_;  // [rows x columns] x/z, y/z; NaN = none
  std::vector<Eigen::Vector3d> points_, unclaimed_;
  std::vector<bool> wanted_;
  std::vector<Track> tracks_;  // in step with balls_
  std::vector<ActorBall> balls_;
  std::uint32_t last_id_ = 0;
  std::int64_t last_us_ = 0;
};

}  // namespace mixstage
