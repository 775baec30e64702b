// SPDX-License-Identifier: Apache-2.0
//
// What an adjustment knows: cameras fixed to each other, boards that stood somewhere before them, and what
// each camera saw of them.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "proto/geometry/board.h"
#include "proto/geometry/frames.h"
#include "server/calibration/board_detection.h"
#include "server/calibration/lens.h"

namespace mixstage {

// A rigid transform as an adjustment changes it: angle-axis, then translation.
using PoseNumbers = std::array<double, 6>;
[[nodiscard]] PoseNumbers NumbersOf(const RigidTransform& T);
[[nodiscard]] RigidTransform TransformOf(const PoseNumbers& numbers);

struct SceneCamera {
  std::string name;
  Lens lens;
  // Maps this camera's frame into the first camera's; identity for the first one. Nothing: not known yet.
  std::optional<RigidTransform> T_first_camera;
  double corner_sigma_px = 0.1;  // of a corner's coordinate, estimated
};

// One board in one view.
struct Placement {
  std::string view;            // its name
  std::size_t view_index = 0;  // of the list the scene was made of
  std::size_t board = 0;       // of the scene's
  std::optional<RigidTransform> T_first_board;
  bool held_out = false;  // its pose is fitted, but no camera learns from it
};

struct SceneSighting {
  std::size_t camera = 0, placement = 0;
  BoardSighting corners;
  std::string file;      // the picture
  std::string left_out;  // why nothing is learned from it; empty = it is used
  double rms_px = 0;     // of its corners' distances after the last adjustment
};

struct BoardScene {
  std::vector<Board> boards;
  std::vector<SceneCamera> cameras;
  std::vector<Placement> placements;
  std::vector<SceneSighting> sightings;

  // Used: not left out, camera and placement have their poses.
  [[nodiscard]] bool Used(const SceneSighting& s) const {
    return s.left_out.empty() && cameras[s.camera].T_first_camera && placements[s.placement].T_first_board;
  }
  // T_camera_board of a used sighting.
  [[nodiscard]] RigidTransform TCameraBoard(std::size_t camera, std::size_t placement) const {
    return cameras[camera].T_first_camera->inverse() * *placements[placement].T_first_board;
  }
};

// Observed minus projected corners of a sighting, px; where the lens cannot see a corner, 1e3 px.
[[nodiscard]] std::vector<Eigen::Vector2d> CornerResiduals(const BoardScene& scene,
                                                           const SceneSighting& sighting);

}  // namespace mixstage
