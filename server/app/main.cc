// SPDX-License-Identifier: Apache-2.0
#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <string>

#include "proto/base/log.h"
#include "proto/base/version.h"
#include "proto/geometry/rig.h"
#include "proto/link/lcm_link.h"
#include "server/app/access_commands.h"
#include "server/app/calibrate.h"
#include "server/app/config.h"
#include "server/app/open_avatar.h"
#include "server/app/open_environment.h"
#include "server/app/process.h"
#include "server/app/regions_file.h"
#include "server/app/run.h"
#include "server/app/scan.h"
#include "server/app/scan_live.h"
#include "server/scene/model_process.h"
#include "server/scene/scene_file.h"

namespace mixstage {
namespace {

// Prints an error in one line; its exit code.
int Report(const Error& error) {
  std::fprintf(stderr, "mixstage-server: %s\n", error.message.c_str());
  return ExitCode(error);
}

struct RunOptions {
  std::string config, rig, environment, scene, regions, clean_plate, listen, lcm, page, record, renderer;
  std::string tokens, audit, tls_certificate, tls_key;
  bool check = false, print = false;
};

int Run(const RunOptions& o) {
  StudioConfig config;
  if (!o.config.empty()) {
    auto loaded = LoadStudioConfig(o.config);
    if (!loaded) return Report(loaded.error());
    config = *loaded;
  }
  if (!o.rig.empty()) config.rig = o.rig;
  if (!o.scene.empty()) config.scene = o.scene;
  if (!o.regions.empty()) config.regions = o.regions;
  if (!o.environment.empty()) config.environment = o.environment;
  if (!o.clean_plate.empty()) config.clean_plate = o.clean_plate;
  if (!o.listen.empty()) config.listen = o.listen;
  if (!o.lcm.empty()) config.lcm_url = o.lcm;
  if (!o.page.empty()) config.page = o.page;
  config.record = o.record;
  if (!o.renderer.empty()) {
    auto renderer = ParseRenderer(o.renderer);
    if (!renderer) return Report(renderer.error());
    config.renderer = *renderer;
  }
  if (!o.tokens.empty()) config.tokens = o.tokens;
  if (!o.audit.empty()) config.audit = o.audit;
  if (!o.tls_certificate.empty()) config.tls.certificate = o.tls_certificate;
  if (!o.tls_key.empty()) config.tls.key = o.tls_key;
  if (o.print) {
    std::fputs(ToYaml(config).c_str(), stdout);
    return 0;
  }
  if (o.check) {
    if (auto ok = CheckShow(config); !ok) return Report(ok.error());
    std::puts("the configuration is good");
    return 0;
  }
  if (auto ok = RunShow(config); !ok) return Report(ok.error());
  return 0;
}

struct ProcessFlags {
  std::string take, rig, environment, clean_plate, scene, regions, poses, out,
      exports = "composite", frames, renderer = "cpu", mesh_format = "drc";
  double depth_unit_m = 0;
  bool encode = false, json = false;
};

// "A:B", ":B", "A:" - colour pictures A up to, not including, B.
Status ParseFrames(const std::string& text, ProcessOptions& options) {
  const std::size_t colon = text.find(':');
  auto number = [](const std::string& digits, int& value) {
    if (digits.empty()) return true;
    if (digits.size() > 9 || digits.find_first_not_of("0123456789") != std::string::npos) return false;
    value = std::stoi(digits);
    return true;
  };
  if (colon == std::string::npos || !number(text.substr(0, colon), options.first_frame) ||
      !number(text.substr(colon + 1), options.end_frame)) {
    return Fail(ErrorCode::kInvalidConfig, "--frames " + text + " is not A:B");
  }
  return {};
}

int Process(const ProcessFlags& f) {
  ProcessOptions options;
  options.take = f.take;
  options.out = f.out;
  auto exports = ParseExports(f.exports);
  if (!exports) return Report(exports.error());
  options.exports = *exports;
  auto mesh_format = ParseMeshFormat(f.mesh_format);
  if (!mesh_format) return Report(mesh_format.error());
  options.mesh_format = *mesh_format;
  if (!f.rig.empty()) options.rig = f.rig;
  if (!f.scene.empty()) options.scene = f.scene;
  if (!f.regions.empty()) options.regions = f.regions;
  if (!f.poses.empty()) options.poses = f.poses;
  if (!f.environment.empty()) options.environment = f.environment;
  if (f.clean_plate == "none") {
    options.clean_plate = CleanPlate::kNone;
  } else if (!f.clean_plate.empty()) {
    options.clean_plate = CleanPlate::kGiven;
    options.clean_plate_folder = f.clean_plate;
  }
  if (!f.frames.empty()) {
    if (auto ok = ParseFrames(f.frames, options); !ok) return Report(ok.error());
  }
  auto renderer = ParseRenderer(f.renderer);
  if (!renderer) return Report(renderer.error());
  options.renderer = *renderer;
  if (f.depth_unit_m > 0) options.depth_unit_m = f.depth_unit_m;
  options.encode = f.encode;
  options.progress = f.json ? Progress::kSilent : Progress::kShow;
  auto report = RunProcess(options);
  if (!report) return Report(report.error());
  if (f.json) std::fputs(report->c_str(), stdout);
  return 0;
}

struct CalibrateFlags {
  std::vector<std::string> views;
  std::string rig, out;
  bool json = false;
};

int Calibrate(const CalibrateFlags& f) {
  CalibrateOptions options;
  options.views.assign(f.views.begin(), f.views.end());
  if (!f.rig.empty()) options.rig = f.rig;
  options.out = f.out;
  auto report = RunCalibrate(options);
  if (!report) return Report(report.error());
  if (f.json) std::fputs(report->c_str(), stdout);
  return 0;
}

struct ScanFlags {
  std::string views, rig, out, merge, patch, lcm = kDefaultLcmUrl, pan, tilt;
  bool live = false, json = false;
};

Result<ScanOutcome> ScanAsTheHeadMoves(const ScanFlags& f) {
  if (!f.views.empty()) return Fail(ErrorCode::kInvalidConfig, "scan takes --views or --live, not both");
  if (f.rig.empty()) return Fail(ErrorCode::kInvalidConfig, "scan --live needs --rig");
  LiveScanOptions options;
  options.rig = f.rig;
  options.lcm_url = f.lcm;
  options.silent = f.json;
  options.out = f.out;
  options.merge = f.merge;
  options.patch = f.patch;
  if (!f.pan.empty()) {
    if (auto ok = ParseSpan(f.pan, options.area.pan_from_deg, options.area.pan_to_deg); !ok)
      return Within("--pan", ok.error());
  }
  if (!f.tilt.empty()) {
    if (auto ok = ParseSpan(f.tilt, options.area.tilt_from_deg, options.area.tilt_to_deg); !ok)
      return Within("--tilt", ok.error());
  }
  return ScanLive(options);
}

int Scan(const ScanFlags& f) {
  if (!f.live && f.views.empty()) {
    return Report({ErrorCode::kInvalidConfig, "scan needs --views DIR, or --live"});
  }
  auto scan = f.live ? ScanAsTheHeadMoves(f)
                     : RunScan({.views = f.views,
                                .rig = f.rig,
                                .out = f.out,
                                .merge = f.merge,
                                .patch = f.patch,
                                .silent = f.json});
  if (!scan) return Report(scan.error());
  if (f.json) std::fputs(scan->report.c_str(), stdout);
  return 0;
}

struct CheckFlags {
  std::string config, rig, environment, scene, regions;
};

int Check(const CheckFlags& f) {
  if (f.config.empty() && f.rig.empty() && f.environment.empty() && f.scene.empty() && f.regions.empty()) {
    return Report(
        {ErrorCode::kInvalidConfig, "check what? Give --config, --rig, --environment, --scene or --regions"});
  }
  if (!f.rig.empty()) {
    auto rig = LoadRig(f.rig);
    if (!rig) return Report(rig.error());
    for (const std::string& warning : rig->warnings)
      std::printf("%s: warning: %s\n", f.rig.c_str(), warning.c_str());
    std::printf("%s: good: colour %d x %d px, depth %s, pan-tilt unit %s\n", f.rig.c_str(),
                rig->rig.color.width, rig->rig.color.height, rig->rig.depth ? "yes" : "no",
                rig->rig.ptu ? "yes" : "no");
  }
  if (!f.environment.empty()) {
    auto opened = OpenEnvironment(f.environment);
    if (!opened) return Report(opened.error());
    const Environment& e = opened->environment;
    auto panorama = ReadPanorama(f.environment, e.panorama);
    if (!panorama) return Report(panorama.error());
    for (const std::string& warning : opened->warnings) std::printf("warning: %s\n", warning.c_str());
    std::printf(
        "%s: good: %zu triangles, panorama %d x %d px, %.1f %% covered, %zu planes, %zu lamps, pan-tilt unit "
        "%s\n",
        f.environment.c_str(), opened->room.model.triangle_count(), e.panorama.width, e.panorama.height,
        100 * e.coverage, e.planes.size(), e.lamps.size(), e.rig.ptu ? "yes" : "no");
  }
  if (!f.scene.empty()) {
    auto scene = LoadScene(f.scene, [](const auto& file) { return LoadModelApart(file); });
    if (!scene) return Report(scene.error());
    for (const std::string& warning : scene->warnings) std::printf("warning: %s\n", warning.c_str());
    auto avatar = OpenAvatar(scene->scene, f.scene);
    if (!avatar) return Report(avatar.error());
    for (const std::string& warning : avatar->warnings) std::printf("warning: %s\n", warning.c_str());
    std::printf("%s: good: %zu objects, %zu lights%s\n", f.scene.c_str(), scene->scene.objects.size(),
                scene->scene.lights.size(), scene->scene.avatar ? ", an avatar" : "");
  }
  if (!f.regions.empty()) {
    auto regions = LoadRegions(f.regions);
    if (!regions) return Report(regions.error());
    std::printf("%s: good: %zu regions\n", f.regions.c_str(), regions->regions.size());
  }
  if (!f.config.empty()) {
    auto config = LoadStudioConfig(f.config);
    if (!config) return Report(config.error());
    // A configuration without a rig is a good one whose rig comes on the command line.
    const Status good = config->rig.empty() ? CheckDelivery(*config) : CheckShow(*config);
    if (!good) return Report(good.error());
    std::printf("%s: good\n", f.config.c_str());
  }
  return 0;
}

}  // namespace
}  // namespace mixstage

int main(int argc, char** argv) {
  using namespace mixstage;
  CLI::App app{"Cuts the actor out of the room, puts virtual objects between, streams colour and depth."};
  app.set_version_flag("--version", std::string("mixstage-server ") + kVersion);
  std::string log_level = "info";
  app.add_option("--log-level", log_level, "trace, debug, info, warn, error or off")->capture_default_str();
  app.require_subcommand(1);
  app.fallthrough();

  RunOptions run;
  CLI::App* run_command = app.add_subcommand("run", "the live show: listens to agents, serves viewers");
  run_command->add_option("--config", run.config, "studio.yaml; what follows overrides it");
  run_command->add_option("--rig", run.rig, "rig.json: the cameras; or a take, whose cameras they are");
  run_command->add_option("--environment", run.environment,
                          "folder of a scanned room: it is keyed against, no clean plate is needed");
  run_command->add_option("--scene", run.scene, "scene.yaml: virtual objects");
  run_command->add_option("--regions", run.regions, "regions.yaml: garbage and hold-out regions of the room");
  run_command->add_option("--clean-plate", run.clean_plate,
                          "capture folder of the empty set (default: learn it live)");
  run_command->add_option("--listen", run.listen,
                          "ADDRESS:PORT (default 127.0.0.1:8080); beyond loopback needs --tokens and TLS");
  run_command->add_option("--lcm", run.lcm, "LCM URL");
  run_command->add_option("--page", run.page, "folder of the built page");
  run_command->add_option("--record", run.record,
                          "folder to record into (a new take): what arrives, as it came");
  run_command->add_option("--renderer", run.renderer, "auto (a GPU where there is one), cpu or egl");
  run_command->add_option("--tokens", run.tokens, "who may log in: the file of mixstage-server token");
  run_command->add_option("--tls-certificate", run.tls_certificate,
                          "PEM file; mixstage-server certificate makes one");
  run_command->add_option("--tls-key", run.tls_key, "PEM file of its key");
  run_command->add_option("--audit", run.audit, "file to append logins and edits to, as JSON lines");
  run_command->add_flag("--check-config", run.check, "read and check everything, then end");
  run_command->add_flag("--print-config", run.print, "print the configuration in force, then end");
  run_command->footer(
      "Example: mixstage-server run --rig rig.json --scene scene.yaml --listen 127.0.0.1:8080");

  ProcessFlags process;
  CLI::App* process_command =
      app.add_subcommand("process", "the same show from a recording, every layer exported");
  process_command->add_option("--take", process.take, "capture folder (TUM RGB-D layout)")->required();
  process_command->add_option("--out", process.out, "folder to write to")->required();
  process_command->add_option("--rig", process.rig, "rig.json (default: the take's, or the one a folder up)");
  CLI::Option* clean_plate =
      process_command->add_option("--clean-plate", process.clean_plate,
                                  "capture folder of the empty set, or none (default: TAKE/clean_plate)");
  process_command
      ->add_option("--environment", process.environment,
                   "folder of a scanned room: it is keyed against, no clean plate is read")
      ->excludes(clean_plate);
  process_command->add_option("--scene", process.scene, "scene.yaml: virtual objects");
  process_command->add_option("--regions", process.regions,
                              "regions.yaml: garbage and hold-out regions of the room");
  process_command->add_option("--poses", process.poses, "camera poses, TUM lines of T_world_color");
  process_command
      ->add_option(
          "--export", process.exports,
          "list out of composite,depth,alpha,label,cg_alpha,lightmap,predicted,mesh,pose,events,report")
      ->capture_default_str();
  process_command->add_option("--mesh-format", process.mesh_format, "of the export mesh: drc, ply or glb")
      ->capture_default_str();
  process_command->add_option("--frames", process.frames, "A:B, colour pictures A up to, not including, B");
  process_command
      ->add_option("--depth-unit-m", process.depth_unit_m, "metres per count of the depth pictures")
      ->check(CLI::PositiveNumber);
  process_command
      ->add_option("--renderer", process.renderer,
                   "cpu (the same bytes on every machine), egl or auto (a GPU where there is one)")
      ->capture_default_str();
  process_command->add_flag("--encode", process.encode, "run the delivery encoders too, to measure them");
  process_command->add_flag("--json", process.json, "print report.json, no progress");
  process_command->footer(
      "Example: mixstage-server process --take monday --scene scene.yaml --out out --export "
      "composite,depth,alpha");

  CalibrateFlags calibrate;
  CLI::App* calibrate_command =
      app.add_subcommand("calibrate", "views of checkerboards to a calibrated rig.json and a report");
  calibrate_command
      ->add_option("--views", calibrate.views,
                   "folder of views: a take's layout and board.json; may be repeated")
      ->required();
  calibrate_command->add_option("--rig", calibrate.rig,
                                "nominal rig.json (default: the first folder's, or the one a folder up)");
  calibrate_command
      ->add_option("--out", calibrate.out, "folder to write rig.json, report.html, report.json to")
      ->required();
  calibrate_command->add_flag("--json", calibrate.json, "print report.json");
  calibrate_command->footer(
      "Example: mixstage-server calibrate --views calib --views calib_wide --out calibrated");

  ScanFlags scan;
  CLI::App* scan_command = app.add_subcommand("scan", "a sweep of the head to a textured model of the room");
  scan_command->add_option("--views", scan.views,
                           "capture folder of the sweep: colour, depth, ptu.txt (or groundtruth.txt)");
  scan_command->add_flag("--live", scan.live,
                         "move an agent's head over the room and record the sweep, into OUT/views");
  scan_command->add_option("--lcm", scan.lcm, "live: LCM URL")->capture_default_str();
  scan_command->add_option("--pan", scan.pan, "live: A:B, what to cover, degrees (default -60:60)");
  scan_command->add_option("--tilt", scan.tilt, "live: C:D (default -50:50)");
  scan_command->add_option(
      "--rig", scan.rig,
      "rig.json of mixstage-server calibrate (default: the folder's, or the one a folder up)");
  scan_command->add_option("--out", scan.out, "environment folder to write")->required();
  CLI::Option* merge = scan_command->add_option(
      "--merge", scan.merge,
      "earlier scan of the room from another position: what it could not see is added");
  scan_command
      ->add_option("--patch", scan.patch, "earlier scan of the room: what has changed since is replaced")
      ->excludes(merge);
  scan_command->add_flag("--json", scan.json, "print report.json, no progress");
  scan_command->footer(
      "Examples: mixstage-server scan --views sweep --rig rig.json --out room\n"
      "          mixstage-server scan --live --rig rig.json --out room\n"
      "          mixstage-server scan --views sofa_moved --rig rig.json --patch room --out room_new");

  CheckFlags check;
  CLI::App* check_command =
      app.add_subcommand("check", "says whether a file is good, or what is wrong with it");
  check_command->add_option("--config", check.config, "studio.yaml");
  check_command->add_option("--rig", check.rig, "rig.json");
  check_command->add_option("--environment", check.environment, "folder of a scanned room");
  check_command->add_option("--scene", check.scene, "scene.yaml");
  check_command->add_option("--regions", check.regions, "regions.yaml");
  check_command->footer("Example: mixstage-server check --rig rig.json");

  TokenCommand token(app);
  CertificateCommand certificate(app);

  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  if (auto ok = StartLog("mixstage-server", log_level); !ok) return Report(ok.error());
  if (token.parsed() || certificate.parsed()) {
    const Status done = token.parsed() ? token.Run() : certificate.Run();
    return done ? 0 : Report(done.error());
  }
  if (run_command->parsed()) return Run(run);
  if (process_command->parsed()) return Process(process);
  if (calibrate_command->parsed()) return Calibrate(calibrate);
  if (scan_command->parsed()) return Scan(scan);
  return Check(check);
}
