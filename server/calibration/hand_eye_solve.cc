// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/hand_eye_solve.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "proto/base/text.h"
#include "server/calibration/board_pose.h"
#include "server/calibration/hand_eye_start.h"

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr std::size_t kLeastViews = 4;
constexpr double kLeastTurn = 5 * kRadPerDeg;
// A view is in doubt beyond this many deviations, and beyond what any room forgives.
constexpr double kDoubt = 4.5, kDoubtRad = 0.05 * kRadPerDeg, kDoubtM = 0.002, kDoubtPx = 0.5;
constexpr double kWorstNoisePx = 1;
constexpr double kContradiction = 3;  // sigmas that a scale has to be off before it is believed
constexpr double kHeldScale = 1e-4;   // how well a scale that nothing contradicts is known

// Largest angle between the hand's rotations of two views with boards.
double TurnCovered(const HandEyeSolve& solve, const std::vector<RigidTransform>& T_base_hand) {
  double most = 0;
  for (const HandEyeSolve::Seen& a : solve.seen)
    for (const HandEyeSolve::Seen& b : solve.seen)
      most = std::max(
          most,
          Eigen::AngleAxisd(T_base_hand[a.view].linear().transpose() * T_base_hand[b.view].linear()).angle());
  return most;
}

// Leaves out the view or board that is farthest beyond doubt. False when none is.
bool RejectWorst(HandEyeSolve& solve) {
  HandEyeAdjustment& problem = solve.problem;
  double worst = 1;
  std::size_t at = 0;
  HandEyeAdjustment::Sighting* board = nullptr;
  std::string reason;
  const int n = problem.corrections();
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    if (!problem.views[v].used) continue;
    for (int k = 0; k < n; ++k) {
      const auto group = static_cast<Eigen::Index>(2 * k / n);
      const bool length = problem.kind == HeadKind::kRobot && group == 1;
      const double value = std::abs(problem.views[v].correction[k]);
      const double ratio =
          value / std::max(kDoubt * problem.encoder_noise[group], length ? kDoubtM : kDoubtRad);
      if (ratio <= worst) continue;
      worst = ratio;
      at = v;
      board = nullptr;
      reason = problem.kind == HeadKind::kRobot
                   ? "the hand's pose is off by " +
                         (length ? Text("%.1f mm", 1000 * value) : Text("%.2f deg", value / kRadPerDeg))
                   : std::string(k == 0 ? "pan" : "tilt") + " encoder " +
                         Text("%.2f deg off", -problem.views[v].correction[k] / kRadPerDeg);
    }
  }
  for (auto& sighting : problem.sightings) {
    if (!sighting.used) continue;
    const double limit = std::max(kDoubt * problem.cameras[sighting.camera].noise_px, kDoubtPx);
    if (sighting.rms_px / limit <= worst) continue;
    worst = sighting.rms_px / limit;
    at = sighting.view;
    board = &sighting;
    reason = solve.boards[sighting.board].name + " is " + Text("%.1f px", sighting.rms_px) +
             " from where it should be";
  }
  if (worst <= 1) return false;
  if (board) {
    board->used = false;
    const bool others = std::any_of(problem.sightings.begin(), problem.sightings.end(),
                                    [&](const auto& s) { return s.used && s.view == at; });
    problem.views[at].used = others;
  } else {
    for (auto& sighting : problem.sightings)
      if (sighting.view == at) sighting.used = false;
    problem.views[at].used = false;
  }
  solve.fits[at].reason = reason;
  return true;
}

// Holds the scale nearest to what is expected of it, then, by what that leaves of the other's deviation, the
// other.
Status HoldScales(HandEyeSolve& solve) {
  HandEyeAdjustment& problem = solve.problem;
  std::array<bool, 2> held{};
  while (problem.kind == HeadKind::kPanTilt) {
    double least = kContradiction;
    std::size_t next = 2;
    for (std::size_t k = 0; k < 2; ++k) {
      const auto i = static_cast<Eigen::Index>(2 + k);
      const double off = std::abs(problem.mechanism[i] - problem.mechanism_expected[i]) /
                         std::sqrt(problem.covariance(i, i));
      if (held[k] || off > least) continue;
      least = off;
      next = k;
    }
    if (next == 2) break;
    const auto i = static_cast<Eigen::Index>(2 + next);
    solve.held.push_back(std::string(next == 0 ? "pan" : "tilt") + " scale at " +
                         Text("%g", problem.mechanism_expected[i]) + ": the views say " +
                         Text("%.4f", problem.mechanism[i]) + " +- " +
                         Text("%.4f", std::sqrt(problem.covariance(i, i))));
    held[next] = true;
    problem.mechanism_sd[i] = kHeldScale;
    if (auto ok = Adjust(problem, OutlierLoss::kHuber); !ok) return ok;
  }
  return {};
}

}  // namespace

HandEyeSolve::HandEyeSolve(const std::vector<Board>& fixed_boards, HeadKind kind, std::size_t views)
    : boards(fixed_boards) {
  problem.kind = kind;
  problem.views.resize(views);
  fits.resize(views);
}

Status CheckSighting(const std::string& view, const std::vector<Board>& boards,
                     const BoardSighting& sighting) {
  if (sighting.board >= boards.size())
    return Fail(ErrorCode::kBadInput, view + ": there is no board " + std::to_string(sighting.board));
  if (sighting.corners.size() != sighting.pixels.size())
    return Fail(ErrorCode::kBadInput, view + ": corners and pixels are not as many");
  for (std::size_t i = 0; i < sighting.corners.size(); ++i)
    if (sighting.corners[i] < 0 || sighting.corners[i] >= boards[sighting.board].corners() ||
        !sighting.pixels[i].allFinite())
      return Fail(ErrorCode::kBadInput, view + ": corner " + std::to_string(i) + " of " +
                                            boards[sighting.board].name + " is not one");
  return {};
}

Status Start(HandEyeSolve& solve, const Eigen::Matrix3d& R_hand_color_guess) {
  HandEyeAdjustment& problem = solve.problem;
  std::vector<BoardInView> in_view;
  std::vector<std::size_t> of_seen;
  for (std::size_t i = 0; i < solve.seen.size(); ++i) {
    const HandEyeSolve::Seen& one = solve.seen[i];
    const auto& camera = problem.cameras[one.camera];
    const Board& board = solve.boards[one.sighting->board];
    HandEyeAdjustment::Sighting sighting;
    sighting.view = one.view;
    sighting.camera = one.camera;
    sighting.board = one.sighting->board;
    for (std::size_t k = 0; k < one.sighting->corners.size(); ++k) {
      sighting.p_board.push_back(board.Corner(one.sighting->corners[k]));
      sighting.pixels.push_back(one.sighting->pixels[k]);
    }
    problem.sightings.push_back(std::move(sighting));
    const auto T_camera_board = PoseOfBoard(camera.lens, board, *one.sighting);
    if (!T_camera_board) continue;
    in_view.push_back({one.view, one.sighting->board, camera.T_camera_color.inverse() * *T_camera_board});
    of_seen.push_back(i);
  }
  std::vector<bool> with_board(solve.names.size(), false);
  for (const BoardInView& one : in_view) with_board[one.view] = true;
  const auto usable = static_cast<std::size_t>(std::count(with_board.begin(), with_board.end(), true));
  if (usable < kLeastViews)
    return Fail(ErrorCode::kQualityGate,
                "hand-eye: " + std::to_string(usable) + " of " + std::to_string(solve.names.size()) +
                    " views have a board and the head's angles; at least 4 are needed");
  if (const double turn = TurnCovered(solve, solve.T_base_hand); turn < kLeastTurn)
    return Fail(ErrorCode::kQualityGate, "hand-eye: the views turn by " + Text("%.1f", turn / kRadPerDeg) +
                                             " deg at most; spread them by at least 5, better 60");

  const std::vector<BoardInView> as_seen = in_view;
  const auto turned = AgreeOnFirstCorner(solve.T_base_hand, solve.boards, in_view);
  const auto start = StartHandEye(solve.T_base_hand, in_view, solve.boards.size(), R_hand_color_guess);
  const auto good =
      start ? static_cast<std::size_t>(std::count(start->good.begin(), start->good.end(), true)) : 0;
  if (good < kLeastViews || 2 * good <= usable) {
    // Would they fit one row on?
    for (const int step : {1, -1}) {
      std::vector<RigidTransform> moved = solve.T_base_hand;
      const auto n = static_cast<int>(moved.size());
      for (int v = 0; v < n; ++v)
        moved[static_cast<std::size_t>(v)] =
            solve.T_base_hand[static_cast<std::size_t>(std::clamp(v + step, 0, n - 1))];
      std::vector<BoardInView> again = as_seen;
      AgreeOnFirstCorner(moved, solve.boards, again);
      const auto other = StartHandEye(moved, again, solve.boards.size(), R_hand_color_guess);
      if (other && other->agreement > 0.7)
        return Fail(
            ErrorCode::kQualityGate,
            "hand-eye: the head's angles are out of step with the pictures, which fit those of the view " +
                std::string(step > 0 ? "after" : "before"));
    }
    return Fail(
        ErrorCode::kQualityGate,
        "hand-eye: the head's angles do not belong to the pictures: " + std::to_string(good) + " of " +
            std::to_string(usable) +
            " views agree; are they in step, pan before tilt, in degrees, and do the boards stand still?");
  }
  for (std::size_t i = 0; i < in_view.size(); ++i) {
    auto& sighting = problem.sightings[of_seen[i]];
    if (turned[i]) {
      const Board& board = solve.boards[sighting.board];
      for (std::size_t k = 0; k < sighting.p_board.size(); ++k)
        sighting.p_board[k] = board.Corner(board.corners() - 1 - solve.seen[of_seen[i]].sighting->corners[k]);
    }
    sighting.used = start->good[sighting.view] && start->T_base_board[sighting.board].has_value();
    if (sighting.used) problem.views[sighting.view].used = true;
  }
  problem.T_hand_color = start->T_hand_color;
  for (const auto& T : start->T_base_board)
    problem.T_base_board.push_back(T.value_or(RigidTransform::Identity()));
  for (std::size_t v = 0; v < solve.names.size(); ++v)
    if (!problem.views[v].used)
      solve.fits[v].reason = !with_board[v] ? "no board" : "the head's angles do not fit its picture";
  return {};
}

Status Fit(HandEyeSolve& solve) {
  HandEyeAdjustment& problem = solve.problem;
  const auto usable =
      std::count_if(problem.views.begin(), problem.views.end(), [](const auto& v) { return v.used; });
  for (int round = 0; round < static_cast<int>(2 * usable); ++round) {
    if (auto ok = Adjust(problem, OutlierLoss::kCauchy); !ok) return ok;
    if (!RejectWorst(solve)) break;
  }
  const auto left =
      std::count_if(problem.views.begin(), problem.views.end(), [](const auto& v) { return v.used; });
  if (left < static_cast<std::ptrdiff_t>(kLeastViews) || 2 * left <= usable)
    return Fail(ErrorCode::kQualityGate, "hand-eye: only " + std::to_string(left) + " of " +
                                             std::to_string(usable) +
                                             " views fit one head and boards that stand still");
  if (auto ok = Adjust(problem, OutlierLoss::kHuber); !ok) return ok;
  if (auto ok = HoldScales(solve); !ok) return ok;
  for (const auto& camera : problem.cameras)
    if (camera.noise_px > kWorstNoisePx)
      return Fail(ErrorCode::kQualityGate, "hand-eye: corners are " + Text("%.1f px", camera.noise_px) +
                                               " off: are the cameras calibrated?");
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    double sum = 0;
    std::size_t count = 0;
    for (const auto& sighting : problem.sightings)
      if (sighting.view == v && sighting.used) {
        sum += sighting.rms_px * sighting.rms_px * static_cast<double>(sighting.pixels.size());
        count += sighting.pixels.size();
      }
    solve.fits[v].used = problem.views[v].used;
    solve.fits[v].rms_px = count ? std::sqrt(sum / static_cast<double>(count)) : 0;
  }
  return {};
}

}  // namespace mixstage
