// SPDX-License-Identifier: Apache-2.0
#include "server/app/scan.h"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>

#include "proto/take/take.h"
#include "server/app/room_file.h"
#include "server/environment/environment_folder.h"
#include "server/environment/scan.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

Json Notes(const std::vector<ViewNote>& notes) {
  Json list = Json::array();
  for (const ViewNote& n : notes) list.push_back({{"view", n.view}, {"reason", n.reason}});
  return list;
}

Json ReportOf(const ScanResult& scan) {
  const Environment& e = scan.environment;
  Json steps = Json::object();
  double total_ms = 0;
  for (const ScanStep& s : scan.report.steps) {
    steps[s.name] = {{"wall_ms", std::round(s.wall_ms)}, {"cpu_ms", std::round(s.cpu_ms)}};
    total_ms += s.wall_ms;
  }
  Json views = Json::array();
  for (const ViewFit& v : scan.report.views) {
    views.push_back({{"view", v.view},
                     {"exposure", v.exposure},
                     {"matches", v.matches},
                     {"rms_px", v.rms_px},
                     {"moved_deg", v.moved_deg}});
  }
  return {{"version", 1},
          {"views", std::move(views)},
          {"left_out", Notes(scan.report.left_out)},
          {"notes", Notes(scan.report.notes)},
          {"coverage", e.coverage},
          {"measured", scan.report.measured},
          {"triangles", scan.room.triangle_count()},
          {"planes", e.planes.size()},
          {"lamps", e.lamps.size()},
          {"panorama_px", {e.panorama.width, e.panorama.height}},
          {"depth_sigma_m", e.depth_sigma_m},
          {"registration_px", e.registration_px},
          {"photometric_rms_levels", scan.report.photometric_rms_levels},
          {"vignetting", {e.rig.vignetting_a, e.rig.vignetting_b}},
          {"steps", steps},
          {"total_ms", total_ms},
          {"warnings", scan.report.warnings}};
}

Status SaveText(const fs::path& file, const std::string& text) {
  std::ofstream out(file);
  if (!(out << text) || !out.flush())
    return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written (is the disk full?)");
  return {};
}

}  // namespace

Result<std::string> RunScan(const ScanOptions& options) {
  auto take = OpenTake(options.views);
  if (!take) return tl::unexpected(take.error());
  RigChoice choice;
  if (!options.rig.empty()) choice.rig_file = options.rig;
  auto rig = RigOfTake(*take, choice);
  if (!rig) return tl::unexpected(rig.error());
  std::vector<PoseSample> listed;
  const fs::path poses = options.views / "groundtruth.txt";
  if (take->head.empty() && fs::exists(poses)) {
    auto read = ReadPoses(poses);
    if (!read) return tl::unexpected(read.error());
    listed = *read;
  }
  auto scan = ScanRoom(*take, rig->rig, listed, [&](const std::string& step) {
    if (!options.silent) std::fprintf(stderr, "scan: %s\n", step.c_str());
  });
  if (!scan) return tl::unexpected(scan.error());
  scan->report.warnings.insert(scan->report.warnings.end(), rig->warnings.begin(), rig->warnings.end());
  if (auto ok = WriteEnvironment(options.out, scan->environment); !ok) return tl::unexpected(ok.error());
  if (auto ok = WritePanorama(options.out, scan->environment.panorama, scan->pictures); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = WriteRoom(options.out, scan->room); !ok) return tl::unexpected(ok.error());
  const std::string report = ReportOf(*scan).dump(1) + "\n";
  if (auto ok = SaveText(options.out / "report.json", report); !ok) return tl::unexpected(ok.error());
  return report;
}

}  // namespace mixstage
