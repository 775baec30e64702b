// SPDX-License-Identifier: Apache-2.0
//
// Where a room's flat surfaces are not what they look like: mirrors, panes and doorways, through which the
// depth camera ranges to what lies behind the wall, and patches that return no light at all. The scan keeps
// what the camera sees there, since that is what a key compares with; people are told.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "server/environment/panorama_grid.h"
#include "server/environment/room_planes.h"

namespace mixstage {

struct Opening {
  enum class Kind {
    kMirror,   // what lies behind it is the room once more, mirrored
    kBehind,   // something else does, or nothing that the sweep saw from the front: mirror, window, doorway
    kNoRange,  // nothing came back: a window, something black, something too far
  };
  Kind kind = Kind::kNoRange;
  std::string plane;  // name of the large plane it interrupts; empty for kNoRange
  double area_m2 = 0;
  Eigen::Vector3d at = Eigen::Vector3d::Zero();  // its middle, world
  double behind_m = 0;                           // along the ray, median; 0 for kNoRange
};

// Largest first. nodes: before FillNodes. described: the planes as DescribePlanes has them. swept [node]:
// directions that a view looked into. grid: what the nodes were made of.
std::vector<Opening> FindOpenings(const SurfaceNodes& nodes, const std::vector<GrownPlane>& planes,
                                  const std::vector<RoomPlane>& described,
                                  const std::vector<std::uint8_t>& swept, const PanoramaGrid& grid);

// One line for the report.
[[nodiscard]] std::string Described(const Opening& opening);

}  // namespace mixstage
