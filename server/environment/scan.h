// SPDX-License-Identifier: Apache-2.0
//
// A sweep of the head (or an RGB-D sequence with poses) to a room (MixIn3D 2.3): the order of the steps. Each
// is a file of this folder.
#pragma once

#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"
#include "proto/take/take.h"
#include "server/environment/environment.h"
#include "server/environment/environment_folder.h"
#include "server/environment/sweep.h"

namespace mixstage {

struct ScanStep {
  std::string name;
  double wall_ms = 0, cpu_ms = 0;
};

// How a view that is used fits the others.
struct ViewFit {
  std::string view;
  double exposure = 1;   // against the sweep's mean
  int matches = 0;       // points found in other views as well
  double rms_px = 0;     // of them, after the refinement
  double moved_deg = 0;  // turn against the pan-tilt unit's own angles or the listed pose
};

struct ScanReport {
  std::vector<ViewFit> views;
  std::vector<ViewNote> left_out;  // views that are not used
  std::vector<ViewNote> notes;     // views that are, with a doubt
  std::vector<std::string> warnings;
  std::vector<std::string> failed_gates;  // why the scan should not be used; empty = it may
  std::vector<ScanStep> steps;
  double measured = 0;  // share of the swept directions where range was measured; the rest is filled in
  static constexpr std::uint8_t kNotSwept = 255;
  // [h x w] of the panorama made smaller: how many views measured range there; 0 = swept, but filled in
  cv::Mat1b measured_by;
  double photometric_rms_levels = 0;  // between views at one point
};

struct ScanResult {
  RoomScan scanned;
  ScanReport report;
};

// listed: poses of a sequence without ptu.txt. progress hears the name of each step as it begins; may be
// empty. Fails (kBadInput) on what no scan can be made of: no depth, no poses, fewer than two good views,
// nothing measured.
Result<ScanResult> ScanRoom(const Take& take, const Rig& rig, const std::vector<PoseSample>& listed,
                            const std::function<void(const std::string&)>& progress);

}  // namespace mixstage
