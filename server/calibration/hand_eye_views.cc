// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/hand_eye_views.h"

#include <algorithm>
#include <map>

namespace mixstage {
namespace {

constexpr double kTurns_deg = 1;

std::string FolderOf(const BoardView& view) { return view.name.substr(0, view.name.rfind('/')); }

struct Angles {
  double least_pan = 1e9, most_pan = -1e9, least_tilt = 1e9, most_tilt = -1e9;
};

}  // namespace

std::optional<HandEyeInput> HandEyeViews(const RigCalibration& c) {
  if (c.scene.cameras.empty() || c.scene.cameras[0].name != kColorName || !c.scene.cameras[0].T_first_camera)
    return std::nullopt;
  std::map<std::string, Angles> folders;
  for (const BoardView& view : c.views) {
    if (!view.head) continue;
    Angles& a = folders[FolderOf(view)];
    a.least_pan = std::min(a.least_pan, view.head->pan_deg);
    a.most_pan = std::max(a.most_pan, view.head->pan_deg);
    a.least_tilt = std::min(a.least_tilt, view.head->tilt_deg);
    a.most_tilt = std::max(a.most_tilt, view.head->tilt_deg);
  }
  HandEyeInput input;
  input.rig = c.rig;
  std::map<std::string, std::size_t> first_board;  // of a folder's own
  for (const auto& [folder, a] : folders) {
    if (std::max(a.most_pan - a.least_pan, a.most_tilt - a.least_tilt) <= kTurns_deg) continue;
    first_board[folder] = input.boards.size();
    input.boards.insert(input.boards.end(), c.scene.boards.begin(), c.scene.boards.end());
  }
  std::map<std::size_t, std::size_t> view_of;  // by the calibration's number
  for (std::size_t v = 0; v < c.views.size(); ++v) {
    const BoardView& view = c.views[v];
    if (!view.head || !first_board.contains(FolderOf(view))) continue;
    view_of[v] = input.views.size();
    HeadView head;
    head.name = view.name;
    head.pan_deg = view.head->pan_deg;
    head.tilt_deg = view.head->tilt_deg;
    input.views.push_back(std::move(head));
  }
  if (input.views.empty()) return std::nullopt;
  for (std::size_t i = 0; i < c.deviations.size(); ++i) {
    if (!c.deviations[i]) continue;
    const std::string& name = c.scene.cameras[i].name;
    (name == kColorName   ? input.color_covariance
     : name == kDepthName ? input.depth_covariance
                          : input.fisheye_covariance) = c.deviations[i]->lens_covariance;
  }
  for (const SceneSighting& s : c.scene.sightings) {
    const Placement& placement = c.scene.placements[s.placement];
    const auto at = view_of.find(placement.view_index);
    if (at == view_of.end() || !c.scene.Used(s)) continue;
    HeadView& view = input.views[at->second];
    const std::string& camera = c.scene.cameras[s.camera].name;
    auto& list = camera == kColorName ? view.color : camera == kDepthName ? view.amplitude : view.fisheye;
    list.push_back(s.corners);
    list.back().board = first_board[FolderOf(c.views[placement.view_index])] + placement.board;
  }
  return input;
}

}  // namespace mixstage
