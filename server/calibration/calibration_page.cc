// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "proto/base/text.h"
#include "server/calibration/calibration_report.h"

namespace mixstage {
namespace {

std::string List(const char* title, const std::vector<std::string>& lines) {
  if (lines.empty()) return "";
  std::string html = std::string("<h2>") + title + "</h2><ul>";
  for (const std::string& line : lines) html += "<li>" + EscapedHtml(line) + "</li>";
  return html + "</ul>";
}

// The picture's frame, every corner, and its residual enlarged so that sigma is some 12 px of the drawing.
std::string Coverage(const BoardScene& scene, std::size_t camera) {
  const SceneCamera& c = scene.cameras[camera];
  const double scale = 460.0 / c.lens.width;
  const double enlarge = 12 / std::max(c.corner_sigma_px, 1e-3);
  std::string svg = Text(
      "<svg width='460' height='%.0f' viewBox='0 0 460 %.0f'><rect width='100%%' height='100%%' "
      "fill='#f4f4f2' stroke='#888'/>",
      scale * c.lens.height, scale * c.lens.height);
  for (const SceneSighting& s : scene.sightings) {
    if (s.camera != camera) continue;
    const bool used = scene.Used(s);
    const auto residuals = used ? CornerResiduals(scene, s) : std::vector<Eigen::Vector2d>();
    for (std::size_t i = 0; i < s.corners.pixels.size(); ++i) {
      const Eigen::Vector2d p = scale * (s.corners.pixels[i].array() + 0.5);
      svg += Text("<circle cx='%.1f' cy='%.1f' r='1.2' fill='%s'/>", p.x(), p.y(), used ? "#2a6" : "#c33");
      if (used) {
        const Eigen::Vector2d q = p + enlarge * residuals[i].cwiseMax(-50).cwiseMin(50);
        svg += Text("<line x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f' stroke='#26a' stroke-width='.6'/>", p.x(),
                    p.y(), q.x(), q.y());
      }
    }
  }
  return svg +
         Text("</svg><p class='small'>corners (red: left out) and their residuals, %.0f times enlarged</p>",
              enlarge / scale);
}

// Distance against tilt of every board.
std::string Spread(const BoardScene& scene, std::size_t camera, const CameraFigures& f) {
  const double far_m = std::max(1.0, 1.1 * f.farthest_m);
  std::string svg =
      "<svg width='300' height='200' viewBox='0 0 300 200'><rect width='100%' height='100%' fill='#f4f4f2' "
      "stroke='#888'/>";
  for (int deg = 0; deg <= 60; deg += 20)
    svg += Text("<text x='2' y='%.0f' font-size='9'>%d&#176;</text>", 185 - deg * 2.7, deg);
  for (int m = 1; m < far_m; ++m)
    svg += Text("<text x='%.0f' y='198' font-size='9'>%d m</text>", 20 + 270 * m / far_m, m);
  for (const SceneSighting& s : scene.sightings) {
    if (s.camera != camera || !scene.Used(s)) continue;
    const Board& board = scene.boards[scene.placements[s.placement].board];
    const RigidTransform T = scene.TCameraBoard(camera, s.placement);
    const Eigen::Vector3d middle = T * Eigen::Vector3d(0.5 * board.Corner(board.corners() - 1));
    const double tilt =
        std::acos(std::clamp(std::abs(T.linear().col(2).dot(middle.normalized())), 0.0, 1.0)) * 57.29578;
    svg += Text("<circle cx='%.1f' cy='%.1f' r='3' fill='#2a6'/>", 20 + 270 * middle.norm() / far_m,
                185 - std::min(tilt, 66.0) * 2.7);
  }
  return svg + "</svg><p class='small'>distance and tilt of the boards</p>";
}

std::string LensTable(const SceneCamera& camera, const std::optional<CameraDeviation>& deviation) {
  std::string html = "<table><tr><th></th><th>value</th><th>std</th></tr>";
  for (int i : camera.lens.free) {
    const auto n = static_cast<std::size_t>(i);
    html += Text("<tr><td>%s</td><td>%.5g</td><td>%.2g</td></tr>", LensNumberName(camera.lens.kind, i),
                 camera.lens.numbers[n], deviation ? deviation->lens[n] : 0.0);
  }
  if (deviation && camera.T_first_camera && deviation->shift_m.norm() > 0) {
    const Eigen::Vector3d t = 1e3 * camera.T_first_camera->translation();
    html +=
        Text("<tr><td>place, mm</td><td>%.1f %.1f %.1f</td><td>%.2f %.2f %.2f</td></tr>", t.x(), t.y(), t.z(),
             1e3 * deviation->shift_m.x(), 1e3 * deviation->shift_m.y(), 1e3 * deviation->shift_m.z());
    html += Text("<tr><td>turn, deg</td><td></td><td>%.3f %.3f %.3f</td></tr>", deviation->turn_deg.x(),
                 deviation->turn_deg.y(), deviation->turn_deg.z());
  }
  return html + "</table>";
}

std::string RangePlot(const RangeCurve& r) {
  std::string svg =
      "<svg width='620' height='220' viewBox='0 0 620 220'><rect width='100%' height='100%' fill='#f4f4f2' "
      "stroke='#888'/>";
  const double last = r.error.range_m.back();
  double largest = 0.005;
  for (double e : r.error.error_m) largest = std::max(largest, std::abs(e));
  auto x = [&](double range) { return 30 + 580 * range / last; };
  auto y = [&](double error) { return 105 - 90 * error / largest; };
  svg += Text("<rect x='%.1f' y='5' width='%.1f' height='200' fill='#dfe9df'/>", x(r.from_m),
              x(r.to_m) - x(r.from_m));
  for (int m = 0; m <= last; ++m) svg += Text("<text x='%.1f' y='216' font-size='10'>%d m</text>", x(m), m);
  svg += Text("<text x='2' y='20' font-size='10'>%.0f mm</text><text x='2' y='109' font-size='10'>0</text>",
              1e3 * largest);
  std::string line;
  std::string above;
  std::string below;
  for (std::size_t i = 0; i < r.error.range_m.size(); ++i) {
    line += Text("%.1f,%.1f ", x(r.error.range_m[i]), y(r.error.error_m[i]));
    above += Text("%.1f,%.1f ", x(r.error.range_m[i]), y(r.error.error_m[i] + 2 * r.error.std_m[i]));
    below += Text("%.1f,%.1f ", x(r.error.range_m[i]), y(r.error.error_m[i] - 2 * r.error.std_m[i]));
  }
  for (const std::string& bound : {above, below})
    svg += "<polyline fill='none' stroke='#9bc' points='" + bound + "'/>";
  svg += "<polyline fill='none' stroke='#26a' stroke-width='1.5' points='" + line + "'/></svg>";
  return svg + Text(
                   "<p class='small'>reported minus true range; green: the distances of the boards; thin: 2 "
                   "sigma. Systematic error "
                   "%.1f mm before, %.1f mm after, %.1f mm in held-out views; black squares %+.1f &#177; "
                   "%.1f mm per decade of "
                   "amplitude</p>",
                   1e3 * r.before_rms_m, 1e3 * r.after_rms_m, 1e3 * r.held_out_rms_m,
                   1e3 * r.dark_minus_bright_m, 1e3 * r.dark_minus_bright_std_m);
}

std::string HeadSection(const HandEyeResult& h) {
  std::string html =
      "<h2>Head</h2>" +
      Text(
          "<p>Between two positions of a sweep (&#177;40&#176; pan, &#177;34&#176; tilt) the colour "
          "camera's pose is predicted to %.3f&#176; and %.2f mm; the encoders' own noise: pan "
          "%.4f&#176;, tilt %.4f&#176;.</p><div class='row'><table>",
          h.sweep_sd_deg, h.sweep_sd_mm, h.pan_noise_deg, h.tilt_noise_deg);
  for (const HandEyeFigure& f : h.figures)
    html += "<tr><td>" + EscapedHtml(f.name) + Text("</td><td>%.4f &#177; %.4f ", f.value, f.sd) +
            EscapedHtml(f.unit) + "</td></tr>";
  html += "</table><table><tr><th>view</th><th>rms px</th><th>pan, tilt off</th><th></th></tr>";
  for (const HandEyeViewFit& v : h.views)
    html += "<tr><td>" + EscapedHtml(v.name) +
            Text("</td><td>%.3f</td><td>%+.4f&#176; %+.4f&#176;</td><td>", v.rms_px, -v.pan_correction_deg,
                 -v.tilt_correction_deg) +
            EscapedHtml(v.reason) + "</td></tr>";
  return html + "</table></div>" + List("Weakly determined", h.weak) + List("Held", h.held);
}

}  // namespace

std::string CalibrationPage(const RigCalibration& c) {
  std::string html =
      "<!doctype html><html lang='en'><meta charset='utf-8'><title>Calibration</title><style>body{font:15px "
      "sans-serif;"
      "max-width:70em;margin:2em auto}table{border-collapse:collapse}td,th{padding:2px "
      "10px;border-bottom:1px solid #ddd;"
      "text-align:left}.small{font-size:12px;color:#555}.row{display:flex;gap:2em;flex-wrap:wrap}.bad{color:#"
      "b00}"
      ".good{color:#262}</style><h1>Calibration</h1>";
  html += c.failed_gates.empty() ? "<p class='good'>Good enough to work with.</p>"
                                 : "<p class='bad'>Not good enough to work with.</p>";
  html += List("Why not", c.failed_gates) + List("What to add", c.advice) + List("Warnings", c.warnings);
  for (std::size_t i = 0; i < c.scene.cameras.size(); ++i) {
    const SceneCamera& camera = c.scene.cameras[i];
    const CameraFigures& f = c.figures[i];
    html += "<h2>" + EscapedHtml(camera.name) + "</h2>" +
            Text("<p>%d boards, corners %.3f px rms, held-out views %.3f px", f.boards, f.rms_px,
                 f.held_out_rms_px);
    if (f.opencv.single_rms_px > 0) html += Text("; OpenCV alone %.3f px", f.opencv.single_rms_px);
    if (f.opencv.stereo_rms_px > 0) html += Text(", stereo %.3f px", f.opencv.stereo_rms_px);
    html += Text(
        "; seen to %.0f&#176; from the axis; %d pictures compared pixel by pixel, their spot %.2f "
        "px.</p><div class='row'><div>",
        f.seen_to_deg, f.fitted_pictures, f.spot_px);
    html += Coverage(c.scene, i) + "</div><div>" + Spread(c.scene, i, f) +
            LensTable(camera, i < c.deviations.size() ? c.deviations[i] : std::nullopt) + "</div></div>";
  }
  if (c.hand_eye) html += HeadSection(*c.hand_eye);
  if (c.range) html += "<h2>Range error</h2>" + RangePlot(*c.range);
  std::vector<std::string> left_out;
  for (const PictureNote& n : c.notes) left_out.push_back(n.file + ": " + n.note);
  for (const SceneSighting& s : c.scene.sightings) {
    if (!s.left_out.empty()) left_out.push_back(s.file + ": " + s.left_out);
  }
  return html + List("Pictures left out", left_out) + "</html>\n";
}

}  // namespace mixstage
