// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <opencv2/core.hpp>

#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/scene/room_probe.h"
#include "server/segmentation/background_model.h"

namespace mixstage {

// The room by the depth of the empty set (D_M), through the colour camera's lens. What a measurement is worth
// stands in the model's sigma: a surface under a pixel is a plane fitted to the samples around it that agree.
class RoomDepthProbe : public RoomProbe {
 public:
  explicit RoomDepthProbe(const PinholeCamera& color);

  // room: null = nothing is known yet. T_scene_color: where the camera stands. up: of the scene's frame.
  void Look(std::shared_ptr<const BackgroundModel> room, const RigidTransform& T_scene_color,
            const Eigen::Vector3d& up);

  [[nodiscard]] std::optional<Ray> RayThrough(double u, double v) const override;
  [[nodiscard]] std::optional<Eigen::Vector3d> SurfaceUnder(double u, double v) const override;
  [[nodiscard]] std::optional<double> HighestSurfaceBelow(const Eigen::Vector3d& base,
                                                          double radius_m) const override;

 private:
  // (x/z, y/z) of a pixel inside the picture.
  [[nodiscard]] std::optional<Eigen::Vector2d> Direction(double u, double v) const;
  // A sample of the room model in the scene; nothing where there is none.
  [[nodiscard]] std::optional<Eigen::Vector3d> Sample(int x, int y) const;
  // Whether the surface around a sample is nearer to the horizontal than to the vertical.
  [[nodiscard]] bool IsLevel(int x, int y) const;

  PinholeCamera color_;
  cv::Mat2f directions_;  // [Quarter(h) x Quarter(w)] (x/z, y/z) of the room model's samples, NaN = no ray
  std::shared_ptr<const BackgroundModel> room_;
  RigidTransform T_scene_color_ = RigidTransform::Identity();
  Eigen::Vector3d up_ = Eigen::Vector3d::UnitZ();
};

}  // namespace mixstage
