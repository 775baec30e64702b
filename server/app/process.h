// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <set>
#include <string>

#include "proto/base/result.h"
#include "server/app/mesh_export.h"
#include "server/raster/render_device.h"

namespace mixstage {

// What `process` can write, by the names of --export (SPEC.md 8).
enum class Export {
  kComposite = 1,
  kDepth,
  kAlpha,
  kLabel,
  kCgAlpha,
  kLightMap,
  kPredicted,
  kMesh,
  kPose,
  kEvents,
  kReport
};

// "composite,alpha,report"; fails (kInvalidConfig) on a name that is none, and lists those that are.
Result<std::set<Export>> ParseExports(const std::string& list);

enum class CleanPlate {
  kDefault = 1,  // the take's own clean_plate folder where there is one
  kNone,         // learn from the take's own frames
  kGiven,        // clean_plate_folder
};

enum class Progress { kShow = 1, kSilent };

struct ProcessOptions {
  std::filesystem::path take, out;
  std::optional<std::filesystem::path> rig, scene, poses, regions;
  CleanPlate clean_plate = CleanPlate::kDefault;
  std::filesystem::path clean_plate_folder;
  std::optional<std::filesystem::path> environment;  // a scanned room: no clean plate is read
  std::set<Export> exports;
  MeshFormat mesh_format = MeshFormat::kDraco;
  int first_frame = 0;  // of the take's colour pictures
  int end_frame = -1;   // one past the last; -1 = all
  std::optional<double> depth_unit_m;
  // cpu: the exports are the same bytes on every machine. Otherwise they are one driver's.
  RendererChoice renderer = RendererChoice::kCpu;
  bool encode = false;  // run the delivery encoders too, to measure them
  Progress progress = Progress::kShow;
};

// Computes the show of a take offline, every frame, through the same stages as live; deterministic. Writes
// the exports and, always, report.json. Returns the report's text.
Result<std::string> RunProcess(const ProcessOptions& options);

}  // namespace mixstage
