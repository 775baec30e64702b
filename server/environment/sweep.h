// SPDX-License-Identifier: Apache-2.0
//
// Which pictures of a capture folder belong to which position of the head (MixIn3D 2.3: the sweep that scans
// a room), and where the head stood there.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "proto/take/take.h"

namespace mixstage {

// One position: a colour picture and the depth frames taken while the head rested there.
struct SweepView {
  std::string name;  // the colour file's stem
  double t_s = 0;    // the colour camera's clock
  double pan_deg = 0, tilt_deg = 0;
  RigidTransform T_world_color = RigidTransform::Identity();  // as the encoders or the poses have it
  std::filesystem::path color;
  std::vector<std::filesystem::path> depth;      // at least one
  std::vector<std::filesystem::path> amplitude;  // one for each depth frame, or none
};

// What a scan does not use, or uses with a doubt, and why: one line for a person.
struct ViewNote {
  std::string view;
  std::string reason;
};

struct Sweep {
  enum class Poses { kPanTilt = 1, kListed };
  Poses poses = Poses::kPanTilt;
  std::vector<SweepView> views;
  std::vector<ViewNote> left_out;
};

// Every colour picture is a position; depth frames go to the one nearest in time. Poses come from ptu.txt and
// rig.ptu, without ptu.txt from `listed` (T_world_color). Views without depth frames or pose are left out.
// Fails (kBadInput) when there is no depth, no pose at all, ptu.txt without rig.ptu, or when fewer than two
// views remain.
Result<Sweep> ListSweep(const Take& take, const Rig& rig, const std::vector<PoseSample>& listed);

}  // namespace mixstage
