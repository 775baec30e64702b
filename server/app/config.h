// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "proto/base/result.h"
#include "proto/link/lcm_link.h"
#include "server/delivery/gateway.h"
#include "server/delivery/video_encoder.h"
#include "server/raster/render_device.h"

namespace mixstage {

// studio.yaml: the configuration of `run`. deploy/studio.yaml is its documentation: every key with its
// default. Relative paths are relative to the file.
struct StudioConfig {
  std::string name = "studio-1";
  std::string lcm_url = kDefaultLcmUrl;
  std::optional<double> parity;       // 0 .. 1, asked of the agents; nothing = they keep their own
  std::filesystem::path rig;          // rig.json
  std::filesystem::path environment;  // folder of a scanned room; empty = none
  std::filesystem::path scene;        // scene.yaml; empty = no CG
  std::filesystem::path regions;      // regions.yaml: garbage and hold-out; empty = none
  std::filesystem::path clean_plate;  // a take of the empty set; empty = learn it live
  int learn_frames = 30;              // L of piVE eq (1)
  RendererChoice renderer = RendererChoice::kAuto;
  std::string listen = "127.0.0.1:8080";
  std::filesystem::path page;  // the built page; empty = the installed one
  std::filesystem::path
      record;  // folder of a new take; by the command line alone: a file would name an old one
  std::filesystem::path tokens;        // who may log in; empty = no login, loopback only
  TlsFiles tls;                        // empty = plain
  std::string osc = "127.0.0.1:9000";  // where contacts are told; "none" = nowhere
  std::filesystem::path audit;         // empty = none is written
  std::vector<std::string> origins;    // pages of elsewhere that may watch
  std::vector<std::string> hosts;      // further names of this server
  VideoEncoderConfig color;
  VideoEncoderConfig depth{.format = VideoFormat::kDepth10, .bitrate_bps = 2'000'000};
};

// Fails (kInvalidConfig) with file, line and key on anything unknown, mistyped or out of range.
Result<StudioConfig> ParseStudioConfig(const std::string& yaml_text, const std::filesystem::path& file);
Result<StudioConfig> LoadStudioConfig(const std::filesystem::path& file);
// The configuration in force, as YAML that LoadStudioConfig reads back.
std::string ToYaml(const StudioConfig& config);

}  // namespace mixstage
