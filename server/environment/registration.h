// SPDX-License-Identifier: Apache-2.0
//
// The poses of a sweep, refined jointly over its overlaps (algorithms 4): start by the pan-tilt unit, end
// where the pictures agree. A pan-tilt unit stays one: its axes and mount are refined, every view may differ
// by what encoders and gears do.
#pragma once

#include <optional>
#include <vector>

#include "proto/geometry/rig.h"
#include "server/environment/view_matches.h"

namespace mixstage {

// How well the start is known, one sigma.
struct RegistrationConfig {
  double axis_deg = 0.1, axis_m = 2e-3;       // of the unit's axes and mount
  double scale = 2e-3;                        // of its encoders
  double encoder_deg = 0.02;                  // of one reading
  double wobble_deg = 2e-3, wobble_m = 1e-4;  // what two axes do not explain
  double pose_deg = 0.5, pose_m = 0.01;       // of listed poses (no pan-tilt unit)
  double match_px = 0.15;                     // of one match, robust beyond three of it
};

struct ViewAngles {
  double pan_deg = 0, tilt_deg = 0;
};

struct Registration {
  std::vector<RigidTransform> T_world_color;
  std::optional<PanTilt> ptu;
  std::vector<double> rms_px;     // of each view's matches (median, scaled), pixels; 0 = it has none
  std::vector<int> matches;       // of each view
  std::vector<double> moved_deg;  // of each view against the unit's own angles, or the listed pose
};

// ptu and angles: of the pan-tilt unit; without it poses move freely about the start. The world stays: the
// mean correction is the priors'. start: the poses that the matches were made with, of a unit or listed.
Registration RefinePoses(const std::vector<ViewMatch>& matches, const PinholeCamera& camera,
                         const std::vector<RigidTransform>& start, const std::vector<RigidTransform>& listed,
                         const std::optional<PanTilt>& ptu, const std::vector<ViewAngles>& angles,
                         const RegistrationConfig& config);

}  // namespace mixstage
