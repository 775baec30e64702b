// SPDX-License-Identifier: Apache-2.0
//
// Capture folders ("takes"): the TUM RGB-D layout, extended (SPEC.md 5). Reading only lists; pictures are
// loaded by picture_files.h when their turn comes.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/geometry/rig.h"

namespace mixstage {

struct TakeEntry {
  double t_s = 0;  // the list's own clock
  std::filesystem::path file;
  [[nodiscard]] std::string stem() const { return file.stem().string(); }
};

struct HeadSample {
  double t_s = 0;
  double pan_deg = 0, tilt_deg = 0;
};

struct PoseSample {
  double t_s = 0;
  RigidTransform T_world_color = RigidTransform::Identity();
};

struct Take {
  std::filesystem::path folder;
  std::vector<TakeEntry> color, depth, amplitude, fisheye;  // times rise; a take's color is never empty
  std::vector<HeadSample> head;                             // ptu.txt, times rise
  std::optional<std::filesystem::path> clean_plate;         // folder/clean_plate, when it is there
  double assumed_depth_unit_m =
      0.001;                          // where no rig.json says it: 0.0002 for the TUM benchmark's own folders
  std::vector<std::string> warnings;  // lines and files that were left out, by name
};

// Fails when the folder or rgb.txt is missing, a line is no "timestamp file", times do not rise, or nothing
// is left. A listed file that is missing or empty, and a last line that no newline ends and nobody can read
// (ptu.txt: any such line), are left out with a warning; a path that leaves the folder is an error.
Result<Take> OpenTake(const std::filesystem::path& folder);

// The same for a folder of views, which may lack colour: fails when no list names a picture that exists.
Result<Take> OpenPictureLists(const std::filesystem::path& folder);

// A trajectory file "timestamp tx ty tz qx qy qz qw" (T_world_color).
Result<std::vector<PoseSample>> ReadPoses(const std::filesystem::path& file);

struct RigChoice {
  std::optional<std::filesystem::path> rig_file;  // --rig; else rig.json in the folder, else one folder up
  std::optional<double> depth_unit_m;             // --depth-unit-m
};

// The rig.json that goes with a take: in its folder, else one folder up.
std::optional<std::filesystem::path> RigFileOf(const std::filesystem::path& folder);

// The rig of a take; assumed (with a warning that says what) where there is no rig.json. Fails when the
// colour pictures are not of the size the rig states.
Result<LoadedRig> RigOfTake(const Take& take, const RigChoice& choice);

}  // namespace mixstage
