// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/calibration_gates.h"

#include "proto/base/text.h"

namespace mixstage {
namespace {

constexpr int kFewestBoards = 5;
constexpr double kFocalDeviation = 0.01;   // of the focal length
constexpr double kCentreDeviation = 0.02;  // of the picture's width
constexpr double kTurnDeviation_deg = 0.3;
constexpr double kShiftDeviation_m = 0.01;
constexpr double kCornerSigma = 0.002;  // of the picture's width, and 0.5 px

void JudgeCamera(const SceneCamera& camera, const CameraFigures& f,
                 const std::optional<CameraDeviation>& deviation, RigCalibration& c) {
  const char* name = camera.name.c_str();
  const Lens& lens = camera.lens;
  if (f.boards < kFewestBoards) {
    c.failed_gates.push_back(
        Text("%s: too few views: %d boards could be used, %d are the least", name, f.boards, kFewestBoards));
    return;
  }
  const double limit_px = std::max(0.5, kCornerSigma * lens.width);
  if (camera.corner_sigma_px > limit_px) {
    c.failed_gates.push_back(
        Text("%s: corners lie %.2f px from where the model puts them (limit %.2f px): wrong "
             "board.json, or a lens this model cannot describe",
             name, camera.corner_sigma_px, limit_px));
  }
  if (!deviation) {
    if (camera.T_first_camera && c.failed_gates.empty())
      c.failed_gates.push_back(Text("%s: none of its boards could be adjusted", name));
    return;
  }
  for (int i = 0; i < 2; ++i) {
    const auto n = static_cast<std::size_t>(i);
    if (deviation->lens[n] > kFocalDeviation * lens.numbers[n]) {
      c.failed_gates.push_back(
          Text("%s: the focal length is not observable: %s = %.1f +- %.1f px; show the board tilted by 30 to "
               "45 degrees",
               name, LensNumberName(lens.kind, i), lens.numbers[n], deviation->lens[n]));
      break;
    }
  }
  if (std::max(deviation->lens[2], deviation->lens[3]) > kCentreDeviation * lens.width) {
    c.failed_gates.push_back(
        Text("%s: the principal point is known to %.1f px only; show the board tilted both ways", name,
             std::max(deviation->lens[2], deviation->lens[3])));
  }
  if (deviation->turn_deg.maxCoeff() > kTurnDeviation_deg ||
      deviation->shift_m.maxCoeff() > kShiftDeviation_m) {
    c.failed_gates.push_back(
        Text("%s: its place on the head is known to %.2f degrees and %.1f mm only; show boards "
             "at more distances and tilts to both cameras",
             name, deviation->turn_deg.maxCoeff(), 1e3 * deviation->shift_m.maxCoeff()));
  }
}

void Advise(const SceneCamera& camera, const CameraFigures& f, RigCalibration& c) {
  const char* name = camera.name.c_str();
  if (camera.lens.kind == LensKind::kFisheye) {
    c.advice.push_back(
        Text("%s: determined to %.0f degrees from the axis; views with the board farther out extend it", name,
             f.seen_to_deg));
  } else if (f.covered < 0.6) {
    c.advice.push_back(
        Text("%s: corners cover %.0f %% of the picture; show the board in its corners and along its edges",
             name, 100 * f.covered));
  }
  if (f.most_tilted_deg < 25)
    c.advice.push_back(Text("%s: boards are tilted by at most %.0f degrees; tilt some by 30 to 45", name,
                            f.most_tilted_deg));
  if (f.farthest_m < 1.6 * f.nearest_m)
    c.advice.push_back(Text("%s: boards stand between %.2f and %.2f m; show some nearer and some farther",
                            name, f.nearest_m, f.farthest_m));
}

}  // namespace

void JudgeCalibration(RigCalibration& c) {
  for (std::size_t i = 0; i < c.scene.cameras.size(); ++i) {
    const SceneCamera& camera = c.scene.cameras[i];
    if (!camera.T_first_camera) {
      if (c.figures[i].boards >= kFewestBoards)
        c.failed_gates.push_back(camera.name + ": shares no view of a board with " + c.scene.cameras[0].name);
      else
        JudgeCamera(camera, c.figures[i], std::nullopt, c);
      continue;
    }
    JudgeCamera(camera, c.figures[i], i < c.deviations.size() ? c.deviations[i] : std::nullopt, c);
    if (c.figures[i].boards >= kFewestBoards) Advise(camera, c.figures[i], c);
  }
  if (c.range) {
    c.advice.push_back(Text(
        "depth: the range error is determined from %.2f to %.2f m%s; boards at other distances extend it",
        c.range->from_m, c.range->to_m,
        c.range->harmonics ? ", beyond by the modulation's harmonics" : ", constant beyond"));
  }
}

}  // namespace mixstage
