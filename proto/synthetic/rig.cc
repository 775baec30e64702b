// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/rig.h"

#include <cmath>
#include <numbers>

#include "proto/synthetic/room_plan.h"

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

// A time-of-flight camera's wiggle: the modulation is no pure sine, so the error repeats along the range.
RangeError Wiggle() {
  RangeError curve;
  for (int i = 2; i <= 30; ++i) {
    const double range_m = 0.25 * i;
    const double error_m = 0.003 + 0.011 * std::sin(2 * std::numbers::pi * range_m / 1.9 + 0.4);
    curve.range_m.push_back(range_m);
    curve.error_m.push_back(std::round(error_m * 1e4) / 1e4);
  }
  return curve;
}

PinholeCamera ColorCamera() {
  PinholeCamera c;
  c.width = 1024;
  c.height = 768;
  c.fx = 1049.5;
  c.fy = 1050.2;
  c.cx = 514.6;
  c.cy = 381.2;
  c.k1 = -0.08;
  c.k2 = 0.03;
  c.p1 = 0.0004;
  c.p2 = -0.0003;
  return c;
}

DepthCamera TimeOfFlightCamera() {
  DepthCamera d;
  d.camera.width = 176;
  d.camera.height = 144;
  d.camera.fx = 158.6;
  d.camera.fy = 158.9;
  d.camera.cx = 87.1;
  d.camera.cy = 72.3;
  d.camera.k1 = -0.12;
  d.camera.k2 = 0.05;
  d.measures = DepthMeasure::kRange;
  d.unit_m = 0.00025;
  d.unambiguous_range_m = 7.4948;
  d.range_error = Wiggle();
  return d;
}

PanTilt Head() {
  PanTilt ptu;
  ptu.pan_axis = {Eigen::Vector3d::UnitZ(), Eigen::Vector3d::Zero()};
  ptu.tilt_axis = {-Eigen::Vector3d::UnitY(), Eigen::Vector3d(0, 0, 0.06)};
  // The camera looks along the base's x: x right = -y, y down = -z, z forward = x.
  ptu.T_tilt_color.matrix() << 0, 0, 1, 0.05,  //
      -1, 0, 0, 0.03,                          //
      0, -1, 0, 0.1,                           //
      0, 0, 0, 1;
  ptu.T_world_base.linear() = Eigen::AngleAxisd(10 * kRadPerDeg, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  ptu.T_world_base.translation() = Eigen::Vector3d(0, 0, 1.32);
  ptu.tilt_offset_deg = -9;
  return ptu;
}

}  // namespace

Rig SyntheticRig() {
  Rig rig;
  rig.color = ColorCamera();
  rig.vignetting_a = -0.17;
  rig.vignetting_b = 0.02;
  rig.depth = TimeOfFlightCamera();
  rig.T_color_depth.linear() = (Eigen::AngleAxisd(0.8 * kRadPerDeg, Eigen::Vector3d::UnitY()) *
                                Eigen::AngleAxisd(-0.5 * kRadPerDeg, Eigen::Vector3d::UnitX()))
                                   .toRotationMatrix();
  rig.T_color_depth.translation() = Eigen::Vector3d(0.064, 0.011, -0.007);
  rig.ptu = Head();
  return rig;
}

RigidTransform SyntheticTWorldColor(const Rig& rig) {
  if (rig.ptu) {
    const RigidTransform T_world_color = rig.ptu->TWorldColor(0, 0);
    if (room_plan::Inside(T_world_color.translation())) return T_world_color;
  }
  return Head().TWorldColor(0, 0);
}

}  // namespace mixstage
