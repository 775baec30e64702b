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

FisheyeCamera Fisheye() {
  FisheyeCamera f;
  f.width = f.height = 640;
  f.fx = 186.4;
  f.fy = 186.7;
  f.cx = 322.8;
  f.cy = 317.1;
  f.k1 = 0.012;
  f.k2 = -0.0035;
  f.k3 = 0.0006;
  f.k4 = -0.00011;
  return f;
}

RigidTransform Turned(double x_deg, double y_deg, double z_deg) {
  RigidTransform T = RigidTransform::Identity();
  T.linear() = (Eigen::AngleAxisd(z_deg * kRadPerDeg, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(y_deg * kRadPerDeg, Eigen::Vector3d::UnitY()) *
                Eigen::AngleAxisd(x_deg * kRadPerDeg, Eigen::Vector3d::UnitX()))
                   .toRotationMatrix();
  return T;
}

// As drawn: the pan axis upright, the tilt axis level, 10 degrees to the left of the room's x.
PanTilt DrawnHead() {
  PanTilt ptu;
  ptu.pan_axis = {Eigen::Vector3d::UnitZ(), Eigen::Vector3d::Zero()};
  ptu.tilt_axis = {-Eigen::Vector3d::UnitY(), Eigen::Vector3d(0, 0, 0.06)};
  // The camera looks along the base's x: x right = -y, y down = -z, z forward = x.
  ptu.T_tilt_color.matrix() << 0, 0, 1, 0.05,  //
      -1, 0, 0, 0.03,                          //
      0, -1, 0, 0.1,                           //
      0, 0, 0, 1;
  ptu.T_world_base = Turned(0, 0, 10);
  ptu.T_world_base.translation() = Eigen::Vector3d(0, 0, 1.32);
  ptu.tilt_offset_deg = -9;
  return ptu;
}

// As built. At rest the camera stands where the drawing has it.
PanTilt Head() {
  PanTilt ptu = DrawnHead();
  ptu.tilt_axis.direction = Turned(0.35, 0, -0.2) * ptu.tilt_axis.direction;
  ptu.tilt_axis.point = Eigen::Vector3d(0.0021, 0, 0.0613);
  ptu.pan_scale = 1.0016;
  ptu.tilt_scale = 0.9987;
  ptu.T_tilt_color.setIdentity();
  ptu.T_tilt_color = ptu.TWorldColor(0, 0).inverse() * DrawnHead().TWorldColor(0, 0);
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
  rig.fisheye = Fisheye();
  rig.T_color_fisheye = Turned(-0.7, 1.1, 0.4);
  rig.T_color_fisheye.translation() = Eigen::Vector3d(-0.058, -0.021, 0.009);
  rig.ptu = Head();
  return rig;
}

Rig SyntheticNominalRig() {
  Rig rig;
  rig.color.width = 1024;
  rig.color.height = 768;
  rig.color.fx = rig.color.fy = 1035;
  rig.color.cx = 511.5;
  rig.color.cy = 383.5;
  rig.depth.emplace();
  rig.depth->camera.width = 176;
  rig.depth->camera.height = 144;
  rig.depth->camera.fx = rig.depth->camera.fy = 162;
  rig.depth->camera.cx = 87.5;
  rig.depth->camera.cy = 71.5;
  rig.depth->measures = DepthMeasure::kRange;
  rig.depth->unit_m = 0.00025;
  rig.depth->unambiguous_range_m = 7.4948;
  rig.fisheye.emplace();
  rig.fisheye->width = rig.fisheye->height = 640;
  rig.fisheye->fx = rig.fisheye->fy = 190;
  rig.fisheye->cx = rig.fisheye->cy = 319.5;
  rig.T_color_depth.translation() = Eigen::Vector3d(0.06, 0.01, 0);
  rig.T_color_fisheye.translation() = Eigen::Vector3d(-0.06, -0.02, 0);
  // The heading is the world's own; height and level were measured.
  rig.ptu = DrawnHead();
  rig.ptu->T_world_base = rig.ptu->T_world_base * Turned(0.4, -0.3, 0);
  rig.ptu->T_world_base.translation().z() = 1.31;
  return rig;
}

RigidTransform SyntheticTWorldColor(const Rig& rig, double pan_deg, double tilt_deg) {
  if (rig.ptu) {
    const RigidTransform T_world_color = rig.ptu->TWorldColor(pan_deg, tilt_deg);
    if (room_plan::Inside(T_world_color.translation())) return T_world_color;
  }
  return Head().TWorldColor(0, 0);
}

}  // namespace mixstage
