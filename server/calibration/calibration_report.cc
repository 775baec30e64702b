// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/calibration_report.h"

#include <nlohmann/json.hpp>

namespace mixstage {
namespace {

using Json = nlohmann::ordered_json;

Json Camera(const SceneCamera& camera, const CameraFigures& f,
            const std::optional<CameraDeviation>& deviation) {
  Json json;
  json["boards"] = f.boards;
  json["corner_sigma_px"] = camera.corner_sigma_px;
  json["rms_px"] = f.rms_px;
  json["held_out"] = {{"boards", f.held_out_boards}, {"rms_px", f.held_out_rms_px}};
  json["pixels"] = {{"pictures", f.fitted_pictures}, {"pixels", f.fitted_pixels}, {"spot_px", f.spot_px}};
  json["opencv"] = {{"calibrate_camera_rms_px", f.opencv.single_rms_px},
                    {"stereo_calibrate_rms_px", f.opencv.stereo_rms_px}};
  json["distance_m"] = {f.nearest_m, f.farthest_m};
  json["most_tilted_deg"] = f.most_tilted_deg;
  json["covered_share"] = f.covered;
  json["determined_to_deg"] = f.seen_to_deg;
  for (int i : camera.lens.free) {
    const auto n = static_cast<std::size_t>(i);
    json["lens"][LensNumberName(camera.lens.kind, i)] = {{"value", camera.lens.numbers[n]}};
    if (deviation) json["lens"][LensNumberName(camera.lens.kind, i)]["std"] = deviation->lens[n];
  }
  if (deviation) {
    json["place_std"] = {
        {"turn_deg", {deviation->turn_deg.x(), deviation->turn_deg.y(), deviation->turn_deg.z()}},
        {"shift_mm",
         {1e3 * deviation->shift_m.x(), 1e3 * deviation->shift_m.y(), 1e3 * deviation->shift_m.z()}}};
  }
  return json;
}

Json Range(const RangeCurve& r) {
  return {{"from_m", r.from_m},
          {"to_m", r.to_m},
          {"beyond", r.harmonics ? "harmonics" : "constant"},
          {"samples", r.samples},
          {"noise_mm", 1e3 * r.noise_m},
          {"systematic_before_mm", 1e3 * r.before_rms_m},
          {"systematic_after_mm", 1e3 * r.after_rms_m},
          {"held_out_rms_mm", 1e3 * r.held_out_rms_m},
          {"dark_minus_bright_mm",
           {{"value", 1e3 * r.dark_minus_bright_m}, {"std", 1e3 * r.dark_minus_bright_std_m}}},
          {"range_m", r.error.range_m},
          {"error_m", r.error.error_m},
          {"std_m", r.error.std_m}};
}

Json HandEye(const HandEyeResult& h) {
  Json json;
  for (const HandEyeFigure& f : h.figures)
    json["figures"].push_back({{"name", f.name}, {"value", f.value}, {"std", f.sd}, {"unit", f.unit}});
  json["noise"] = {{"pan_deg", h.pan_noise_deg},
                   {"tilt_deg", h.tilt_noise_deg},
                   {"color_px", h.color_noise_px},
                   {"amplitude_px", h.amplitude_noise_px},
                   {"fisheye_px", h.fisheye_noise_px}};
  json["sweep_std"] = {{"deg", h.sweep_sd_deg}, {"mm", h.sweep_sd_mm}};
  json["weak"] = h.weak;
  json["held"] = h.held;
  json["views"] = Json::array();
  for (const HandEyeViewFit& v : h.views) {
    Json view = {{"name", v.name},
                 {"used", v.used},
                 {"rms_px", v.rms_px},
                 {"pan_correction_deg", v.pan_correction_deg},
                 {"tilt_correction_deg", v.tilt_correction_deg}};
    if (!v.reason.empty()) view["why"] = v.reason;
    json["views"].push_back(std::move(view));
  }
  return json;
}

}  // namespace

std::string CalibrationJson(const RigCalibration& c, double seconds) {
  Json json;
  json["good"] = c.failed_gates.empty();
  json["failed_gates"] = c.failed_gates;
  json["warnings"] = c.warnings;
  json["advice"] = c.advice;
  json["views"] = c.views.size();
  for (std::size_t i = 0; i < c.scene.cameras.size(); ++i) {
    json["cameras"][c.scene.cameras[i].name] =
        Camera(c.scene.cameras[i], c.figures[i], i < c.deviations.size() ? c.deviations[i] : std::nullopt);
  }
  if (c.range) json["range_error"] = Range(*c.range);
  if (c.hand_eye) json["hand_eye"] = HandEye(*c.hand_eye);
  json["left_out"] = Json::array();
  for (const PictureNote& n : c.notes) json["left_out"].push_back({{"file", n.file}, {"why", n.note}});
  for (const SceneSighting& s : c.scene.sightings) {
    const bool noted =
        std::any_of(c.notes.begin(), c.notes.end(), [&](const PictureNote& n) { return n.file == s.file; });
    if (!s.left_out.empty() && !noted) json["left_out"].push_back({{"file", s.file}, {"why", s.left_out}});
  }
  json["boards"] = Json::array();
  for (const SceneSighting& s : c.scene.sightings) {
    json["boards"].push_back({{"file", s.file},
                              {"camera", c.scene.cameras[s.camera].name},
                              {"board", c.scene.boards[c.scene.placements[s.placement].board].name},
                              {"corners", s.corners.corners.size()},
                              {"rms_px", s.rms_px},
                              {"edge_rise_px", s.corners.rise_px},
                              {"used", s.left_out.empty()}});
  }
  json["seconds"] = seconds;
  return json.dump(1) + "\n";
}

}  // namespace mixstage
