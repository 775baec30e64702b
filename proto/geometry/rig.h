// SPDX-License-Identifier: Apache-2.0
//
// rig.json: the cameras of a head, how they sit to each other, and the pan-tilt unit (SPEC.md, "rig.json").
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"

namespace mixstage {

enum class DepthMeasure {
  kRange = 1,  // length along the ray (time of flight)
  kZ,          // along the optical axis
};

// What a ToF camera's systematic error is at a range: it reports range + error(range). Piecewise linear,
// constant outside the given ranges; empty = 0.
struct RangeError {
  std::vector<double> range_m;  // rising
  std::vector<double> error_m;
  std::vector<double> std_m = {};  // how well error_m is known, one sigma; empty = not said
  [[nodiscard]] double At(double range_m) const;
  [[nodiscard]] double StdAt(double range_m) const;  // 0 where it is not said
  // The true range of a reported one: the fixed point of r = reported - error(r).
  [[nodiscard]] double TrueRange(double reported_m) const;
  bool operator==(const RangeError&) const = default;
};

struct DepthCamera {
  PinholeCamera camera;
  DepthMeasure measures = DepthMeasure::kRange;
  double unit_m = 0.001;                      // metres per count of the 16-bit picture
  std::optional<double> unambiguous_range_m;  // reported ranges are wrapped at it; nothing = no wrap
  RangeError range_error;
};

struct PanTilt {
  struct Axis {
    Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
  };
  Axis pan_axis, tilt_axis;
  RigidTransform T_tilt_color = RigidTransform::Identity();
  RigidTransform T_world_base = RigidTransform::Identity();
  double pan_scale = 1, pan_offset_deg = 0, tilt_scale = 1, tilt_offset_deg = 0;

  // T_world_color at encoder angles: T_world_base R(pan) R(tilt) T_tilt_color, axes at zero angles.
  [[nodiscard]] RigidTransform TWorldColor(double pan_deg, double tilt_deg) const;
};

struct Rig {
  PinholeCamera color;
  double vignetting_a = 0, vignetting_b = 0;  // gain 1 + a r^2 + b r^4, r = 1 at the half diagonal
  std::optional<DepthCamera> depth;
  std::optional<FisheyeCamera> fisheye;
  RigidTransform T_color_depth = RigidTransform::Identity();
  RigidTransform T_color_fisheye = RigidTransform::Identity();
  bool registered = false;  // depth is already in the colour camera's pixels
  double depth_time_offset_s = 0, fisheye_time_offset_s = 0;  // added to a stream's times: colour's clock
  std::optional<PanTilt> ptu;
};

struct LoadedRig {
  Rig rig;
  std::vector<std::string> warnings;  // unknown keys, by name
};

// Fails (kBadInput, the field named) on NaN, a non-rigid transform, a singular K, wrong types or versions.
Result<LoadedRig> ParseRig(const std::string& json_text);
Result<LoadedRig> LoadRig(const std::filesystem::path& file);

// The file of a rig: ParseRig reads the same numbers back, bit for bit but for angles (degrees there).
std::string FormatRig(const Rig& rig);

// What is assumed where a take has no rig.json: registered depth, fx = fy = 0.9 x width, centre of the
// picture.
Rig AssumedRig(int color_width, int color_height, double depth_unit_m);

}  // namespace mixstage
