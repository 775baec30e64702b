// SPDX-License-Identifier: Apache-2.0
//
// An empty room with a block in it, by formula: the truth of tests of the scan.
#pragma once

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>

#include "proto/geometry/rig.h"
#include "server/environment/range_view.h"

namespace mixstage {

// Walls, floor and ceiling seen from inside, a block seen from outside; world z up, floor at 0.
struct BoxRoom {
  Eigen::AlignedBox3d room{Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(5, 4, 2.6)};
  Eigen::AlignedBox3d block{Eigen::Vector3d(3, 1.4, 0), Eigen::Vector3d(3.6, 2.2, 1.1)};

  // Length along the unit ray to the first surface; from inside the room, outside the block.
  [[nodiscard]] double Range(const Eigen::Vector3d& from, const Eigen::Vector3d& ray) const {
    double leave = std::numeric_limits<double>::infinity(), enter = 0, exit = leave;
    for (int k = 0; k < 3; ++k) {
      if (std::abs(ray[k]) < 1e-12) {
        if (from[k] < block.min()[k] || from[k] > block.max()[k]) exit = -1;
        continue;
      }
      leave = std::min(leave, ((ray[k] > 0 ? room.max()[k] : room.min()[k]) - from[k]) / ray[k]);
      const double a = (block.min()[k] - from[k]) / ray[k], b = (block.max()[k] - from[k]) / ray[k];
      enter = std::max(enter, std::min(a, b));
      exit = std::min(exit, std::max(a, b));
    }
    return exit > enter && enter > 0 ? enter : leave;
  }
};

// A rig with a depth camera 7 cm beside the colour camera.
inline Rig BoxRoomRig() {
  Rig rig;
  rig.color = {.width = 320, .height = 240, .fx = 330, .fy = 330, .cx = 161, .cy = 118, .k1 = -0.1};
  DepthCamera depth;
  depth.camera = {.width = 88, .height = 72, .fx = 110, .fy = 110, .cx = 44, .cy = 35, .k1 = -0.2};
  depth.unit_m = 0.00025;
  depth.unambiguous_range_m = 7.5;
  rig.depth = depth;
  rig.T_color_depth.translation() = Eigen::Vector3d(0.07, -0.02, 0);
  return rig;
}

// A camera at `at` that looks to azimuth and elevation, upright.
inline RigidTransform LookTo(const Eigen::Vector3d& at, double azimuth_rad, double elevation_rad) {
  RigidTransform T = RigidTransform::Identity();
  const Eigen::Vector3d z(std::cos(elevation_rad) * std::cos(azimuth_rad),
                          std::cos(elevation_rad) * std::sin(azimuth_rad), std::sin(elevation_rad));
  const Eigen::Vector3d x = z.cross(Eigen::Vector3d::UnitZ()).normalized();
  T.linear().col(0) = x;
  T.linear().col(1) = z.cross(x);
  T.linear().col(2) = z;
  T.translation() = at;
  return T;
}

// The room as a depth camera there measures it, every pixel with noise of sigma_m.
inline RangeView SeeBoxRoom(const BoxRoom& room, const RangeCamera& camera,
                            const RigidTransform& T_world_depth, double sigma_m, std::mt19937& random) {
  std::normal_distribution<double> normal(0, sigma_m);
  RangeView view{cv::Mat1f(camera.ray.size()), cv::Mat1f(camera.ray.size(), static_cast<float>(sigma_m))};
  for (int y = 0; y < view.range_m.rows; ++y) {
    for (int x = 0; x < view.range_m.cols; ++x) {
      const cv::Vec3f n = camera.ray(y, x);
      const Eigen::Vector3d ray = T_world_depth.linear() * Eigen::Vector3d(n[0], n[1], n[2]);
      view.range_m(y, x) = static_cast<float>(room.Range(T_world_depth.translation(), ray) + normal(random));
    }
  }
  return view;
}

}  // namespace mixstage
