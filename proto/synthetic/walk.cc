// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/walk.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "proto/base/check.h"

namespace mixstage {
namespace {

using Eigen::Vector2d;
constexpr double kPi = std::numbers::pi;

// The way in: straight at the far depth, half a circle, straight back at the near depth.
constexpr double kFarX = 4.10, kNearX = 3.35, kStartY = -2.7, kTurnY = 1.2, kStandY = 0.35;
constexpr double kRadius = 0.5 * (kFarX - kNearX);
constexpr double kStraight = kTurnY - kStartY;
constexpr double kWayIn = kStraight + kPi * kRadius + kTurnY - kStandY;

constexpr double kStepsIn = 11;
constexpr double kStepIn = kWayIn / kStepsIn;  // m
constexpr double kStepOut = 0.56;
constexpr double kRate = 1.7;                                 // steps per second
constexpr double kSlowFrom = 10, kSlowFor_s = 2 * 2 / kRate;  // the last two steps slow down to a stop
constexpr double kStand_s = kEnter_s + kSlowFrom / kRate + kSlowFor_s;
constexpr double kTurn_s = kStand_s - 0.45;  // he starts to turn to the camera with the last step
constexpr double kBack_s = 17.0;             // turns away again
constexpr double kOut_s = 17.75;             // first step of the way out
constexpr double kSpeedUp_s = 1.0;
constexpr double kHalfWidth = 0.085;  // m: the feet beside the path

// Faces the camera from where he stands; from -90 degrees that is a turn to the right.
const double kFaceCamera = std::atan2(-kStandY, -kNearX);
constexpr double kFaceOut = -0.5 * kPi;

double Smooth(double from, double to, double x) {
  const double t = std::clamp((x - from) / (to - from), 0.0, 1.0);
  return t * t * t * (t * (6 * t - 15) + 10);
}

// Smooth maximum of x and 0, with a knee about 0.25 wide.
double SoftPlus(double x) { return x > 6 ? x : 0.25 * std::log1p(std::exp(4 * x)); }

Vector2d PointIn(double s) {
  if (s < kStraight) return {kFarX, kStartY + s};
  if (s < kStraight + kPi * kRadius) {
    const double angle = (s - kStraight) / kRadius;
    return {kNearX + kRadius + kRadius * std::cos(angle), kTurnY + kRadius * std::sin(angle)};
  }
  return {kNearX, kTurnY - (s - kStraight - kPi * kRadius)};
}

// Turning starts before the curve does: the heading averaged over half a metre.
double HeadingIn(double s) {
  double sum = 0;
  constexpr int kPoints = 9;
  for (int i = 0; i < kPoints; ++i) {
    const double at = s + 0.07 * (i - kPoints / 2);
    sum += 0.5 * kPi + std::clamp((at - kStraight) / kRadius, 0.0, kPi);
  }
  return sum / kPoints;
}

Vector2d LeftOf(double yaw) { return {-std::sin(yaw), std::cos(yaw)}; }

double PhaseIn(double t) {
  const double dt = t - kEnter_s;
  if (dt < kSlowFrom / kRate) return kRate * dt;
  const double slow = std::min(dt - kSlowFrom / kRate, kSlowFor_s);
  return kSlowFrom + kRate * slow - 0.5 * kRate / kSlowFor_s * slow * slow;
}
double TimeIn(double phase) {
  if (phase < kSlowFrom) return kEnter_s + phase / kRate;
  const double left = kSlowFor_s * kSlowFor_s - 2 * kSlowFor_s * (phase - kSlowFrom) / kRate;
  return kEnter_s + kSlowFrom / kRate + kSlowFor_s - std::sqrt(std::max(0.0, left));
}
double PhaseOut(double t) {
  const double dt = std::max(0.0, t - kOut_s);
  return dt < kSpeedUp_s ? 0.5 * kRate / kSpeedUp_s * dt * dt : kRate * (dt - 0.5 * kSpeedUp_s);
}
double TimeOut(double phase) {
  const double fast = 0.5 * kRate * kSpeedUp_s;
  return kOut_s +
         (phase < fast ? std::sqrt(2 * phase * kSpeedUp_s / kRate) : phase / kRate + 0.5 * kSpeedUp_s);
}

// Footprints: the body passes the middle of step n above footprint n. Even ones are the right foot's.
constexpr int kLeft = 0, kRight = 1;
int FootOf(int footprint) { return footprint % 2 == 0 ? kRight : kLeft; }
double SideOf(int foot) { return foot == kLeft ? 1 : -1; }
constexpr double kToeOut = 0.10;  // rad

}  // namespace

double Walk::LoopTime(double time_s) {
  const double t = std::fmod(time_s, kLoop_s);
  return t < 0 ? t + kLoop_s : t;
}

bool Walk::Present(double time_s) {
  const double t = LoopTime(time_s);
  return t >= kEnter_s && t < kLeave_s;
}

Walk::Walk() {
  auto add = [&](int foot, double lift_s, double land_s, const Vector2d& path, double yaw) {
    const double toes = yaw + SideOf(foot) * kToeOut;
    steps_[foot].push_back({lift_s, land_s, path + SideOf(foot) * kHalfWidth * LeftOf(yaw), toes});
  };
  // Way in: footprint n at (n + 1/2) steps; the first two are where he starts.
  auto print_in = [&](int n, double lift_s, double land_s) {
    const double s = std::min((n + 0.5) * kStepIn, kWayIn);
    add(FootOf(n), lift_s, land_s, PointIn(s), std::remainder(HeadingIn(s), 2 * kPi));
  };
  print_in(-1, 0, 0);
  print_in(0, 0, 0);
  for (int n = 0; n <= 11; ++n) {
    const double lift_s = TimeIn(n + 0.06);
    print_in(n + 1, lift_s, std::min(TimeIn(n + 0.94), lift_s + 0.62));
  }
  // Turn to the camera, later back: one step of each foot.
  const Vector2d stand(kNearX, kStandY);
  const double last_land_s = std::max(steps_[kLeft].back().land_s, steps_[kRight].back().land_s);
  add(kLeft, last_land_s + 0.02, last_land_s + 0.47, stand, kFaceCamera + 0.1);
  add(kRight, last_land_s + 0.50, last_land_s + 0.92, stand, kFaceCamera - 0.05);
  add(kLeft, kBack_s + 0.05, kBack_s + 0.45, stand, kFaceOut - 0.3);
  add(kRight, kBack_s + 0.47, kBack_s + 0.79, stand, kFaceOut);
  // Way out: the body leads by half a step.
  for (int n = 0; n <= 8; ++n) {
    const double s = (n + 1) * kStepOut;
    const double lift_s = std::max(TimeOut(n + 0.06), kBack_s + 0.82);
    add(FootOf(n + 1), lift_s, std::max(lift_s + 0.3, TimeOut(n + 0.94)), stand + Vector2d(0, -s), kFaceOut);
  }
}

WalkState Walk::At(double time_s) const {
  MIX_CHECK(Present(time_s));
  const double t = LoopTime(time_s);
  WalkState state;
  if (t < kBack_s) {
    state.phase = PhaseIn(t);
    const double s = kStepIn * (kStepsIn - SoftPlus(kStepsIn - state.phase));
    state.body = PointIn(s);
    const double turn = Smooth(kTurn_s, kTurn_s + 1.35, t);
    const double heading = std::remainder(HeadingIn(s), 2 * kPi);
    state.yaw_rad = turn > 0 ? heading + turn * (kFaceCamera - heading) : heading;
    state.stride = 1 - Smooth(10.0, 11.7, state.phase);
  } else {
    state.phase = PhaseOut(t);
    const double s = kStepOut * (SoftPlus(state.phase - 0.5) - SoftPlus(-0.5));
    state.body = Vector2d(kNearX, kStandY - s);
    state.yaw_rad = kFaceCamera + Smooth(kBack_s, kBack_s + 1.0, t) * (kFaceOut - kFaceCamera);
    state.stride = Smooth(0.0, 1.2, state.phase);
  }
  for (const int foot : {kLeft, kRight}) {
    const std::vector<Step>& steps = steps_[foot];
    std::size_t i = 0;
    while (i + 1 < steps.size() && steps[i + 1].lift_s <= t) ++i;
    FootPose& pose = state.foot[foot];
    const Step& now = steps[i];
    const Step& before = steps[i > 0 ? i - 1 : 0];
    const double along = t < now.land_s ? (t - now.lift_s) / (now.land_s - now.lift_s) : 0;
    const double eased = t < now.land_s ? Smooth(0, 1, 0.25 + 0.75 * along - 0.25 * (1 - along)) : 1;
    const double moved = t < now.land_s ? 0.5 * (eased + along * along * (3 - 2 * along)) : 1;
    const Vector2d place = before.place + moved * (now.place - before.place);
    pose.ankle_rest = {place.x(), place.y(), 0};
    pose.yaw_rad = before.yaw_rad + moved * std::remainder(now.yaw_rad - before.yaw_rad, 2 * kPi);
    pose.swing = along;
    pose.lift = std::sin(kPi * along);
  }
  state.wave = Smooth(12.3, 13.1, t) - Smooth(14.9, 15.6, t);
  state.wave_angle = 0.38 * std::sin(2 * kPi * 1.35 * (t - 12.9));
  state.present = Smooth(15.2, 15.9, t) - Smooth(16.5, 17.2, t);
  // He looks where he goes; to the camera while he waves, to what he presents after.
  state.look_yaw_rad = 0.18 * (Smooth(5.5, 6.5, t) - Smooth(8.3, 9.2, t)) + 0.55 * state.present;
  return state;
}

}  // namespace mixstage
