// SPDX-License-Identifier: Apache-2.0
//
// What a scan knows about a room (MixIn3D 2.3): environment.json of an environment folder (SPEC.md 9).
// Lengths in metres, everything in the world's frame.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "server/environment/panorama.h"

namespace mixstage {

// A view of the sweep where the joint refinement put it.
struct SweepFrame {
  std::string name;  // the colour file's stem
  RigidTransform T_world_color = RigidTransform::Identity();
};

enum class PlaneKind { kFloor = 1, kCeiling, kWall, kTable, kOther };
[[nodiscard]] const char* PlaneKindName(PlaneKind kind);

struct RoomPlane {
  std::string name;
  PlaneKind kind = PlaneKind::kOther;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // of length 1, into the room
  double d = 0;                                       // normal . x + d = 0
  std::vector<Eigen::Vector3d> polygon;               // what was seen of it, counter-clockwise; may be empty
};

// An area light as in scene.yaml: edges are full side vectors, it shines along edge_u x edge_v.
struct RoomLamp {
  std::string name;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  Eigen::Vector3d edge_u = Eigen::Vector3d::UnitX(), edge_v = Eigen::Vector3d::UnitY();
  Eigen::Vector3d color = Eigen::Vector3d::Ones();  // linear light, >= 0
  double intensity = 1;                             // color x intensity: radiance, 1.0 = the picture's white
};

struct Environment {
  // The cameras and the pan-tilt unit as refined by the scan; ptu where the sweep had one. Its vignetting is
  // taken out of the room's colours.
  Rig rig;
  std::vector<SweepFrame> frames;
  Panorama panorama;
  std::vector<RoomPlane> planes;
  std::vector<RoomLamp> lamps;
  double coverage = 0;         // share 0..1 of the swept directions that have a surface
  double depth_sigma_m = 0;    // >= 0: a surface's typical error along its ray
  double registration_px = 0;  // >= 0: typical error of a texture's place, pixels of the colour camera
};

struct ParsedEnvironment {
  Environment environment;
  std::vector<std::string> warnings;  // unknown keys, by name
};

// Fails (kBadInput, the field named) on everything that is not as above: types, NaN, sizes, limits (10,000
// frames, 256 planes of 1,024 corners, 256 lamps).
Result<ParsedEnvironment> ParseEnvironment(const std::string& json_text);
// ParseEnvironment reads the same numbers back, bit for bit but for the rig's angles.
std::string FormatEnvironment(const Environment& environment);

}  // namespace mixstage
