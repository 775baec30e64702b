// SPDX-License-Identifier: Apache-2.0
//
// What a scanned room says about light (MixIn3D 3.2): its lamps, and its surfaces as they shine onto a point.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "server/environment/environment_folder.h"
#include "server/render/ambient_light.h"
#include "server/scene/scene.h"

namespace mixstage {

class RoomRadiance {
 public:
  // room is valid (checked).
  RoomRadiance(const RoomModel& room, const std::vector<RoomLamp>& lamps);

  // Ids 1, 2, ...; world frame.
  [[nodiscard]] const std::vector<Light>& lamps() const { return lamps_; }
  // Of everything in the room but the lamps, in the world's frame; what hides what is not asked.
  [[nodiscard]] AmbientLight At(const Eigen::Vector3d& point) const;

 private:
  // Triangles of one neighbourhood that face alike.
  struct Patch {
    Eigen::Vector3f center = Eigen::Vector3f::Zero();
    Eigen::Vector3f facing = Eigen::Vector3f::Zero();    // normal times area
    Eigen::Vector3f radiance = Eigen::Vector3f::Zero();  // linear light
  };
  std::vector<Light> lamps_;
  std::vector<Patch> patches_;
};

}  // namespace mixstage
