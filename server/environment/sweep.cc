// SPDX-License-Identifier: Apache-2.0
#include "server/environment/sweep.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace mixstage {
namespace {

constexpr double kPoseGap_s = 0.5;     // a listed pose farther in time says nothing about a picture
constexpr double kSameFrame_s = 1e-3;  // amplitude and range are one exposure

std::size_t Nearest(const std::vector<double>& times, double t_s) {
  const auto after =
      static_cast<std::size_t>(std::lower_bound(times.begin(), times.end(), t_s) - times.begin());
  if (after == 0) return 0;
  if (after == times.size() || t_s - times[after - 1] <= times[after] - t_s) return after - 1;
  return after;
}

template <typename Sample>
std::vector<double> TimesOf(const std::vector<Sample>& samples) {
  std::vector<double> times;
  for (const Sample& s : samples) times.push_back(s.t_s);
  return times;
}

// How long a position lasts: half the way to the next picture at most.
double Dwell(const std::vector<double>& times, std::size_t i) {
  double dwell = std::numeric_limits<double>::infinity();
  if (i > 0) dwell = std::min(dwell, times[i] - times[i - 1]);
  if (i + 1 < times.size()) dwell = std::min(dwell, times[i + 1] - times[i]);
  return std::isfinite(dwell) ? dwell / 2 : 1.0;
}

}  // namespace

Result<Sweep> ListSweep(const Take& take, const Rig& rig, const std::vector<PoseSample>& listed) {
  const std::string folder = take.folder.string();
  if (take.depth.empty() || !rig.depth) {
    return Fail(ErrorCode::kBadInput, take.depth.empty()
                                          ? folder + ": has no depth.txt: a scan needs depth pictures"
                                          : "the rig has no depth camera: a scan needs one");
  }
  Sweep sweep;
  sweep.poses = take.head.empty() ? Sweep::Poses::kListed : Sweep::Poses::kPanTilt;
  if (!take.head.empty() && !rig.ptu) {
    return Fail(ErrorCode::kBadInput,
                "the rig has no ptu section: mixstage-server calibrate finds the head's axes from views with "
                "ptu.txt");
  }
  if (take.head.empty() && listed.empty()) {
    return Fail(ErrorCode::kBadInput,
                folder + ": has neither ptu.txt nor groundtruth.txt: where the camera stood is not known");
  }
  const std::vector<double> color_times = TimesOf(take.color);
  const std::vector<double> pose_times = take.head.empty() ? TimesOf(listed) : TimesOf(take.head);
  const std::vector<double> amplitude_times = TimesOf(take.amplitude);
  std::vector<std::vector<std::size_t>> depth_of_view(take.color.size());
  for (std::size_t i = 0; i < take.depth.size(); ++i) {
    const double t_s = take.depth[i].t_s + rig.depth_time_offset_s;
    const std::size_t view = Nearest(color_times, t_s);
    if (std::abs(t_s - color_times[view]) <= Dwell(color_times, view)) depth_of_view[view].push_back(i);
  }
  for (std::size_t v = 0; v < take.color.size(); ++v) {
    SweepView view;
    view.name = take.color[v].stem();
    view.t_s = color_times[v];
    view.color = take.color[v].file;
    const std::size_t pose = Nearest(pose_times, view.t_s);
    if (std::abs(pose_times[pose] - view.t_s) > std::min(kPoseGap_s, Dwell(color_times, v))) {
      sweep.left_out.push_back({view.name, "no pose at its time"});
      continue;
    }
    if (sweep.poses == Sweep::Poses::kPanTilt) {
      view.pan_deg = take.head[pose].pan_deg;
      view.tilt_deg = take.head[pose].tilt_deg;
      view.T_world_color = rig.ptu->TWorldColor(view.pan_deg, view.tilt_deg);
    } else {
      view.T_world_color = listed[pose].T_world_color;
    }
    bool amplitude_of_each = !take.amplitude.empty();
    for (const std::size_t i : depth_of_view[v]) {
      view.depth.push_back(take.depth[i].file);
      if (!amplitude_of_each) continue;
      const std::size_t a = Nearest(amplitude_times, take.depth[i].t_s);
      amplitude_of_each = std::abs(amplitude_times[a] - take.depth[i].t_s) <= kSameFrame_s;
      view.amplitude.push_back(take.amplitude[a].file);
    }
    if (!amplitude_of_each) view.amplitude.clear();
    if (view.depth.empty()) {
      sweep.left_out.push_back({view.name, "no depth frame at its time"});
      continue;
    }
    sweep.views.push_back(std::move(view));
  }
  if (sweep.views.size() < 2) {
    return Fail(ErrorCode::kBadInput, folder + ": " + std::to_string(sweep.views.size()) +
                                          " views have colour, depth and a pose: a scan needs at least two");
  }
  return sweep;
}

}  // namespace mixstage
