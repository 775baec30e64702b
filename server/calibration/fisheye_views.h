// SPDX-License-Identifier: Apache-2.0
//
// Perspective views cut out of a fisheye picture: straight lines are straight in them, so a detector made for
// ordinary lenses works far off the axis.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/geometry/camera_model.h"

namespace mixstage {

struct FisheyeView {
  Eigen::Matrix3d R_fisheye_view = Eigen::Matrix3d::Identity();
  int side_px = 0;  // square
  double focal_px = 0;
};

// Views of 80 degrees that overlap by about half and cover the camera's field; the nearest to the axis first.
[[nodiscard]] std::vector<FisheyeView> ViewsAround(const FisheyeCamera& camera);

// [side x side]; black where the fisheye has no ray.
[[nodiscard]] cv::Mat1b DrawView(const cv::Mat1b& fisheye, const FisheyeCamera& camera,
                                 const FisheyeView& view);

// Pixel of a view to the pixel of the fisheye picture that was drawn there; nothing outside the picture.
[[nodiscard]] std::optional<Eigen::Vector2d> ToFisheye(const FisheyeCamera& camera, const FisheyeView& view,
                                                       const Eigen::Vector2d& pixel);

}  // namespace mixstage
