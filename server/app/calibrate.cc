// SPDX-License-Identifier: Apache-2.0
#include "server/app/calibrate.h"

#include <chrono>
#include <cstdio>
#include <fstream>

#include "server/calibration/calibration_report.h"
#include "server/calibration/rig_calibration.h"

namespace mixstage {
namespace {

Status Write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file, std::ios::binary);
  out << text;
  out.close();
  if (!out) return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written");
  return {};
}

Result<NominalRig> Nominal(const CalibrateOptions& options) {
  const auto file = options.rig ? options.rig : RigFileOf(options.views.front());
  if (!file) return NominalRig();
  auto loaded = LoadRig(*file);
  if (!loaded) return tl::unexpected(loaded.error());
  for (const std::string& warning : loaded->warnings)
    std::fprintf(stderr, "%s: warning: %s\n", file->c_str(), warning.c_str());
  return NominalRig{.rig = std::move(loaded->rig), .given = true};
}

}  // namespace

Result<std::string> RunCalibrate(const CalibrateOptions& options) {
  const auto start = std::chrono::steady_clock::now();
  auto seconds = [&] {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  };
  auto nominal = Nominal(options);
  if (!nominal) return tl::unexpected(nominal.error());
  std::vector<ViewFolder> folders;
  for (const auto& path : options.views) {
    auto folder = OpenViewFolder(path, nominal->rig.depth_time_offset_s, nominal->rig.fisheye_time_offset_s);
    if (!folder) return tl::unexpected(folder.error());
    folders.push_back(std::move(*folder));
  }
  std::error_code error;
  std::filesystem::create_directories(options.out, error);
  if (error) return Fail(ErrorCode::kUnavailable, options.out.string() + ": " + error.message());
  auto calibration = CalibrateRig(folders, *nominal, [&](const std::string& what) {
    std::fprintf(stderr, "%5.1f s  %s\n", seconds(), what.c_str());
  });
  if (!calibration) return tl::unexpected(calibration.error());
  const std::string report = CalibrationJson(*calibration, seconds());
  if (auto ok = Write(options.out / "report.json", report); !ok) return tl::unexpected(ok.error());
  if (auto ok = Write(options.out / "report.html", CalibrationPage(*calibration)); !ok)
    return tl::unexpected(ok.error());
  if (!calibration->failed_gates.empty()) {
    std::filesystem::remove(options.out / "rig.json",
                            error);  // one of an earlier run would be taken for this one's
    return Fail(ErrorCode::kQualityGate, calibration->failed_gates.front() + " (" +
                                             (options.out / "report.html").string() + " says more)");
  }
  if (auto ok = Write(options.out / "rig.json", FormatRig(calibration->rig)); !ok)
    return tl::unexpected(ok.error());
  std::fprintf(stderr, "%5.1f s  wrote %s\n", seconds(), (options.out / "rig.json").c_str());
  return report;
}

}  // namespace mixstage
