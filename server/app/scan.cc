// SPDX-License-Identifier: Apache-2.0
#include "server/app/scan.h"

#include <openssl/evp.h>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>

#include "proto/base/text.h"
#include "proto/take/take.h"
#include "server/app/room_file.h"
#include "server/environment/environment_folder.h"
#include "server/environment/join_rooms.h"
#include "server/environment/scan.h"

namespace mixstage {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr double kLeastMet = 0.5;  // of what a scan sees of an earlier one: rooms change, but not that much

Json Notes(const std::vector<ViewNote>& notes) {
  Json list = Json::array();
  for (const ViewNote& n : notes) list.push_back({{"view", n.view}, {"reason", n.reason}});
  return list;
}

Json ReportOf(const ScanResult& scan, const std::optional<JoinReport>& joined) {
  const Environment& e = scan.scanned.environment;
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
  Json join = nullptr;
  if (joined) {
    join = {{"turn_deg", joined->turn_deg},
            {"shift_m", joined->shift_m},
            {"met", joined->met},
            {"apart_m", joined->apart_m},
            {"gain", joined->gain},
            {"triangles_dropped", joined->dropped},
            {"triangles_added", joined->added}};
  }
  return {{"version", 1},
          {"views", std::move(views)},
          {"left_out", Notes(scan.report.left_out)},
          {"notes", Notes(scan.report.notes)},
          {"joined", std::move(join)},
          {"failed_gates", scan.report.failed_gates},
          {"coverage", e.coverage},
          {"measured", scan.report.measured},
          {"triangles", scan.scanned.room.triangle_count()},
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

// A picture inside the page.
std::string Inline(const cv::Mat& picture) {
  constexpr int kMostWidth = 1400;
  cv::Mat small = picture;
  if (picture.cols > kMostWidth) {
    const double scale = static_cast<double>(kMostWidth) / picture.cols;
    cv::resize(picture, small, {}, scale, scale, cv::INTER_AREA);
  }
  std::vector<std::uint8_t> jpeg;
  cv::imencode(".jpg", small, jpeg, {cv::IMWRITE_JPEG_QUALITY, 85});
  std::string text(4 * ((jpeg.size() + 2) / 3) + 1, '\0');  // base64 and the zero that ends it
  EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()), jpeg.data(), static_cast<int>(jpeg.size()));
  text.pop_back();
  return "<img src=\"data:image/jpeg;base64," + text + "\">";
}

std::string Row(std::initializer_list<std::string> cells) {
  std::string row = "<tr>";
  for (const std::string& cell : cells) row.append("<td>").append(EscapedHtml(cell)).append("</td>");
  return row + "</tr>\n";
}

std::string Number(double value, int digits) { return Text("%.*f", digits, value); }

// How many views measured range: green, the more the brighter; red where it is filled in.
cv::Mat3b CoverageMap(const cv::Mat1b& measured_by) {
  constexpr int kMany = 4;
  cv::Mat3b map(measured_by.size(), cv::Vec3b(0, 0, 0));
  for (int y = 0; y < map.rows; ++y) {
    for (int x = 0; x < map.cols; ++x) {
      const int n = measured_by(y, x);
      if (n == ScanReport::kNotSwept) continue;
      const auto level = static_cast<std::uint8_t>(60 + 180 * std::min(n, kMany) / kMany);
      map(y, x) = n == 0 ? cv::Vec3b(40, 40, 220) : cv::Vec3b(80, level, 60);
    }
  }
  return map;
}

// Every lamp's outline in the panorama, with its name.
void OutlineLamps(const Environment& e, cv::Mat& panorama) {
  const double size = panorama.cols / 1400.0;
  const int line = std::max(1, static_cast<int>(std::lround(2 * size)));
  const cv::Scalar color(0, 220, 255);
  for (const RoomLamp& lamp : e.lamps) {
    std::vector<cv::Point> outline;  // straight edges bend in a panorama
    constexpr int kPieces = 16;      // of each
    const std::array<Eigen::Vector2d, 4> corners = {{{-0.5, -0.5}, {0.5, -0.5}, {0.5, 0.5}, {-0.5, 0.5}}};
    for (int i = 0; i < 4 * kPieces; ++i) {
      const Eigen::Vector2d from = corners[static_cast<std::size_t>(i / kPieces)];
      const Eigen::Vector2d to = corners[static_cast<std::size_t>(i / kPieces + 1) % 4];
      const Eigen::Vector2d at = from + (i % kPieces) * (to - from) / kPieces;
      const Eigen::Vector3d point = lamp.center + at.x() * lamp.edge_u + at.y() * lamp.edge_v;
      if (const auto pixel = e.panorama.Pixel(point - e.panorama.center))
        outline.emplace_back(cv::saturate_cast<int>(pixel->x()), cv::saturate_cast<int>(pixel->y()));
    }
    if (outline.empty()) continue;
    cv::polylines(panorama, outline, true, color, line, cv::LINE_AA);
    cv::putText(panorama, lamp.name, outline.back() + cv::Point(0, static_cast<int>(24 * size)),
                cv::FONT_HERSHEY_SIMPLEX, 0.7 * size, color, line, cv::LINE_AA);
  }
}

std::string HtmlOf(const ScanResult& scan) {
  const Environment& e = scan.scanned.environment;
  const ScanReport& r = scan.report;
  cv::Mat range, colored, color;
  scan.scanned.pictures.range_mm.convertTo(range, CV_8U, 255.0 / 8000);
  cv::applyColorMap(range, colored, cv::COLORMAP_TURBO);
  colored.setTo(cv::Scalar(0, 0, 0), scan.scanned.pictures.range_mm == 0);
  cv::cvtColor(scan.scanned.pictures.color_bgra, color, cv::COLOR_BGRA2BGR);
  OutlineLamps(e, color);
  std::string html =
      "<!doctype html><meta charset=\"utf-8\"><title>MixStage: scan</title>\n<style>body{font:15px "
      "sans-serif;max-width:"
      "1400px;margin:1em auto}img{max-width:100%}td,th{padding:2px 10px;text-align:left}</style>\n<h1>Scan "
      "of a room</h1>\n";
  html += "<table>" + Row({"Views used", std::to_string(e.frames.size())}) +
          Row({"Covered of the swept directions", Number(100 * e.coverage, 1) + " %"}) +
          Row({"of which measured (the rest is filled in)", Number(100 * r.measured, 1) + " %"}) +
          Row({"Typical error of a surface", Number(1000 * e.depth_sigma_m, 2) + " mm"}) +
          Row({"Points of two views apart", Number(e.registration_px, 2) + " px"}) +
          Row({"Brightness of two views apart", Number(r.photometric_rms_levels, 2) + " levels"}) +
          Row({"Triangles", std::to_string(scan.scanned.room.triangle_count())}) + "</table>\n";
  html += "<h2>Left out, and used with a doubt</h2>\n<table>";
  for (const ViewNote& n : r.left_out) html += Row({n.view, "left out", n.reason});
  for (const ViewNote& n : r.notes) html += Row({n.view, "used", n.reason});
  for (const std::string& gate : r.failed_gates) html += Row({"", "not good enough", gate});
  for (const std::string& w : r.warnings) html += Row({"", "warning", w});
  if (r.left_out.empty() && r.notes.empty() && r.warnings.empty() && r.failed_gates.empty())
    html += Row({"nothing"});
  html += "</table>\n<h2>Colour, lamps outlined</h2>\n" + Inline(color) +
          "\n<h2>Range, black: not known; red: 8 m</h2>\n" + Inline(colored) +
          "\n<h2>Coverage: views that measured range, one to four and more; red: filled in; black: not "
          "swept</h2>\n" +
          Inline(CoverageMap(r.measured_by));
  html +=
      "\n<h2>Views</h2>\n<table><tr><th>view<th>exposure<th>points shared<th>apart, px<th>moved, "
      "degrees</tr>\n";
  for (const ViewFit& v : r.views)
    html += Row({v.view, Number(v.exposure, 3), std::to_string(v.matches), Number(v.rms_px, 2),
                 Number(v.moved_deg, 3)});
  html += "</table>\n<h2>Planes</h2>\n<table>";
  for (const RoomPlane& p : e.planes)
    html += Row(
        {p.name, Number(p.normal.x(), 4), Number(p.normal.y(), 4), Number(p.normal.z(), 4), Number(p.d, 4)});
  html += "</table>\n<h2>Lamps</h2>\n<table>";
  for (const RoomLamp& l : e.lamps) {
    html += Row(
        {l.name,
         "at " + Number(l.center.x(), 2) + ", " + Number(l.center.y(), 2) + ", " + Number(l.center.z(), 2),
         Number(l.edge_u.norm(), 2) + " x " + Number(l.edge_v.norm(), 2) + " m",
         "radiance " + Number(l.intensity, 1)});
  }
  return html + "</table>\n";
}

Result<RoomScan> ReadRoomScan(const fs::path& folder) {
  auto environment = ReadEnvironment(folder);
  if (!environment) return tl::unexpected(environment.error());
  auto pictures = ReadPanorama(folder, environment->environment.panorama);
  if (!pictures) return tl::unexpected(pictures.error());
  auto room = ReadRoom(folder);
  if (!room) return tl::unexpected(room.error());
  return RoomScan{std::move(environment->environment), std::move(*pictures), std::move(*room)};
}

Status SaveText(const fs::path& file, const std::string& text) {
  std::ofstream out(file);
  if (!(out << text) || !out.flush())
    return Fail(ErrorCode::kUnavailable, file.string() + ": cannot be written (is the disk full?)");
  return {};
}

}  // namespace

Result<ScanOutcome> RunScan(const ScanOptions& options) {
  std::optional<RoomScan> earlier;
  if (const fs::path& folder = options.merge.empty() ? options.patch : options.merge; !folder.empty()) {
    auto read = ReadRoomScan(folder);
    if (!read) return tl::unexpected(read.error());
    earlier = std::move(*read);
  }
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
  const auto began = [&](const std::string& step) {
    if (!options.silent) std::fprintf(stderr, "scan: %s\n", step.c_str());
    if (options.on_step) options.on_step(step);
  };
  auto scan = ScanRoom(*take, rig->rig, listed, began);
  if (!scan) return tl::unexpected(scan.error());
  scan->report.warnings.insert(scan->report.warnings.end(), rig->warnings.begin(), rig->warnings.end());
  std::optional<JoinReport> joined;
  if (earlier) {
    joined.emplace();
    began("join");
    const RigidTransform T_earlier_new = MeetRooms(*earlier, scan->scanned, *joined);
    if (joined->met < kLeastMet) {
      return Fail(ErrorCode::kQualityGate,
                  Text("%s: %.0f %% of what this scan sees there meets its surfaces (limit %.0f %%): scan "
                       "the same room, with ptu.T_world_base of the rig right to 0.3 m and 10 degrees",
                       (options.merge.empty() ? options.patch : options.merge).c_str(), 100 * joined->met,
                       100 * kLeastMet));
    }
    scan->scanned = JoinRooms(*earlier, scan->scanned, T_earlier_new,
                              options.merge.empty() ? Join::kPatch : Join::kMerge, *joined);
  }
  const RoomScan& room = scan->scanned;
  if (auto ok = WriteEnvironment(options.out, room.environment); !ok) return tl::unexpected(ok.error());
  if (auto ok = WritePanorama(options.out, room.environment.panorama, room.pictures); !ok)
    return tl::unexpected(ok.error());
  if (auto ok = WriteRoom(options.out, room.room); !ok) return tl::unexpected(ok.error());
  if (auto ok = SaveText(options.out / "report.html", HtmlOf(*scan)); !ok) return tl::unexpected(ok.error());
  const std::string report = ReportOf(*scan, joined).dump(1) + "\n";
  if (auto ok = SaveText(options.out / "report.json", report); !ok) return tl::unexpected(ok.error());
  if (!scan->report.failed_gates.empty()) {
    return Fail(ErrorCode::kQualityGate, scan->report.failed_gates.front() + " (" +
                                             (options.out / "report.html").string() + " says more)");
  }
  return ScanOutcome{report, room.environment.coverage, static_cast<int>(room.room.triangle_count()),
                     scan->report.left_out};
}

}  // namespace mixstage
