// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/hand_eye.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <optional>

#include "server/calibration/board_pose.h"
#include "server/calibration/hand_eye_adjustment.h"
#include "server/calibration/hand_eye_start.h"

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr std::size_t kLeastViews = 4;
constexpr double kLeastTurn = 5 * kRadPerDeg;
// What is weak: worse than this shows in a room (0.05 deg are 4 mm at 5 m).
constexpr double kWeakRad = 0.05 * kRadPerDeg, kWeakM = 0.002;
// A view is in doubt beyond this many deviations, and beyond what any room forgives.
constexpr double kDoubt = 4.5, kDoubtRad = 0.05 * kRadPerDeg, kDoubtM = 0.002, kDoubtPx = 0.5;
constexpr double kWorstNoisePx = 1, kWorstNoiseRad = 0.3 * kRadPerDeg;
constexpr double kContradiction = 3;  // sigmas that a scale has to be off before it is believed
constexpr double kHeldScale = 1e-4;   // how well a scale that nothing contradicts is known

std::string Number(const char* format, double value) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

RigidTransform Turn(const Eigen::Vector3d& axis, double angle_rad) {
  return RigidTransform(Eigen::AngleAxisd(angle_rad, axis));
}

// A sighting that a camera of the input has, with what the start makes of it.
struct Seen {
  std::size_t view, camera;
  const BoardSighting* sighting;
};

struct Session {
  const std::vector<Board>& boards;
  std::vector<std::string> names;
  std::vector<RigidTransform> T_base_hand;  // ideal: axes at right angles through the origin
  std::vector<Seen> seen;
  HandEyeAdjustment problem;
  std::vector<HandEyeViewFit> fits;
  std::vector<std::string> held;
};

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

// Largest angle between the hand's rotations of two views with boards.
double TurnCovered(const Session& session, const std::vector<RigidTransform>& T_base_hand) {
  double most = 0;
  for (const Seen& a : session.seen)
    for (const Seen& b : session.seen)
      most = std::max(
          most,
          Eigen::AngleAxisd(T_base_hand[a.view].linear().transpose() * T_base_hand[b.view].linear()).angle());
  return most;
}

// Poses of boards, the agreement of the views, and from that the adjustment's start.
Status Begin(Session& session, const Eigen::Matrix3d& R_hand_color_guess) {
  HandEyeAdjustment& problem = session.problem;
  std::vector<BoardInView> in_view;
  std::vector<std::size_t> of_seen;
  for (std::size_t i = 0; i < session.seen.size(); ++i) {
    const Seen& one = session.seen[i];
    const auto& camera = problem.cameras[one.camera];
    const Board& board = session.boards[one.sighting->board];
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
  std::vector<bool> with_board(session.names.size(), false);
  for (const BoardInView& one : in_view) with_board[one.view] = true;
  const auto usable = static_cast<std::size_t>(std::count(with_board.begin(), with_board.end(), true));
  if (usable < kLeastViews)
    return Fail(ErrorCode::kQualityGate,
                "hand-eye: " + std::to_string(usable) + " of " + std::to_string(session.names.size()) +
                    " views have a board and the head's angles; at least 4 are needed");
  if (const double turn = TurnCovered(session, session.T_base_hand); turn < kLeastTurn)
    return Fail(ErrorCode::kQualityGate, "hand-eye: the views turn by " + Number("%.1f", turn / kRadPerDeg) +
                                             " deg at most; spread them by at least 5, better 60");

  const std::vector<BoardInView> as_seen = in_view;
  const auto turned = AgreeOnFirstCorner(session.T_base_hand, session.boards, in_view);
  const auto start = StartHandEye(session.T_base_hand, in_view, session.boards.size(), R_hand_color_guess);
  const auto good =
      start ? static_cast<std::size_t>(std::count(start->good.begin(), start->good.end(), true)) : 0;
  if (good < kLeastViews || 2 * good <= usable) {
    // Would they fit one row on?
    for (const int step : {1, -1}) {
      std::vector<RigidTransform> moved = session.T_base_hand;
      const auto n = static_cast<int>(moved.size());
      for (int v = 0; v < n; ++v)
        moved[static_cast<std::size_t>(v)] =
            session.T_base_hand[static_cast<std::size_t>(std::clamp(v + step, 0, n - 1))];
      std::vector<BoardInView> again = as_seen;
      AgreeOnFirstCorner(moved, session.boards, again);
      const auto other = StartHandEye(moved, again, session.boards.size(), R_hand_color_guess);
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
      const Board& board = session.boards[sighting.board];
      for (std::size_t k = 0; k < sighting.p_board.size(); ++k)
        sighting.p_board[k] =
            board.Corner(board.corners() - 1 - session.seen[of_seen[i]].sighting->corners[k]);
    }
    sighting.used = start->good[sighting.view] && start->T_base_board[sighting.board].has_value();
    if (sighting.used) problem.views[sighting.view].used = true;
  }
  problem.T_hand_color = start->T_hand_color;
  for (const auto& T : start->T_base_board)
    problem.T_base_board.push_back(T.value_or(RigidTransform::Identity()));
  for (std::size_t v = 0; v < session.names.size(); ++v)
    if (!problem.views[v].used)
      session.fits[v].reason = !with_board[v] ? "no board" : "the head's angles do not fit its picture";
  return {};
}

// Leaves out the view or board that is farthest beyond doubt. False when none is.
bool RejectWorst(Session& session) {
  HandEyeAdjustment& problem = session.problem;
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
                         (length ? Number("%.1f mm", 1000 * value) : Number("%.2f deg", value / kRadPerDeg))
                   : std::string(k == 0 ? "pan" : "tilt") + " encoder " +
                         Number("%.2f deg off", -problem.views[v].correction[k] / kRadPerDeg);
    }
  }
  for (auto& sighting : problem.sightings) {
    if (!sighting.used) continue;
    const double limit = std::max(kDoubt * problem.cameras[sighting.camera].noise_px, kDoubtPx);
    if (sighting.rms_px / limit <= worst) continue;
    worst = sighting.rms_px / limit;
    at = sighting.view;
    board = &sighting;
    reason = session.boards[sighting.board].name + " is " + Number("%.1f px", sighting.rms_px) +
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
  session.fits[at].reason = reason;
  return true;
}

// Holds the scale nearest to what is expected of it, then, by what that leaves of the other's deviation, the
// other.
Status HoldScales(Session& session) {
  HandEyeAdjustment& problem = session.problem;
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
    session.held.push_back(std::string(next == 0 ? "pan" : "tilt") + " scale at " +
                           Number("%g", problem.mechanism_expected[i]) + ": the views say " +
                           Number("%.4f", problem.mechanism[i]) + " +- " +
                           Number("%.4f", std::sqrt(problem.covariance(i, i))));
    held[next] = true;
    problem.mechanism_sd[i] = kHeldScale;
    if (auto ok = Adjust(problem, OutlierLoss::kHuber); !ok) return ok;
  }
  return {};
}

Status AdjustSession(Session& session) {
  HandEyeAdjustment& problem = session.problem;
  const auto usable =
      std::count_if(problem.views.begin(), problem.views.end(), [](const auto& v) { return v.used; });
  for (int round = 0; round < static_cast<int>(2 * usable); ++round) {
    if (auto ok = Adjust(problem, OutlierLoss::kCauchy); !ok) return ok;
    if (!RejectWorst(session)) break;
  }
  const auto left =
      std::count_if(problem.views.begin(), problem.views.end(), [](const auto& v) { return v.used; });
  if (left < static_cast<std::ptrdiff_t>(kLeastViews) || 2 * left <= usable)
    return Fail(ErrorCode::kQualityGate, "hand-eye: only " + std::to_string(left) + " of " +
                                             std::to_string(usable) +
                                             " views fit one head and boards that stand still");
  if (auto ok = Adjust(problem, OutlierLoss::kHuber); !ok) return ok;
  if (auto ok = HoldScales(session); !ok) return ok;
  for (const auto& camera : problem.cameras)
    if (camera.noise_px > kWorstNoisePx)
      return Fail(ErrorCode::kQualityGate, "hand-eye: corners are " + Number("%.1f px", camera.noise_px) +
                                               " off: are the cameras calibrated?");
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    double sum = 0;
    std::size_t count = 0;
    for (const auto& sighting : problem.sightings)
      if (sighting.view == v && sighting.used) {
        sum += sighting.rms_px * sighting.rms_px * static_cast<double>(sighting.pixels.size());
        count += sighting.pixels.size();
      }
    session.fits[v].used = problem.views[v].used;
    session.fits[v].rms_px = count ? std::sqrt(sum / static_cast<double>(count)) : 0;
  }
  return {};
}

struct Direction {
  std::string name;
  double unit;  // what counts as weak
  double per_unit;
  const char* text;
};

// The directions of the covariance that are weak, each as what trades against what.
std::vector<std::string> WeakDirections(const Eigen::MatrixXd& covariance, const std::vector<Direction>& of) {
  const auto n = static_cast<Eigen::Index>(of.size());
  Eigen::MatrixXd scaled = covariance;
  for (Eigen::Index i = 0; i < n; ++i)
    for (Eigen::Index k = 0; k < n; ++k)
      scaled(i, k) /= of[static_cast<std::size_t>(i)].unit * of[static_cast<std::size_t>(k)].unit;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scaled);
  std::vector<std::string> weak;
  for (Eigen::Index e = n - 1; e >= 0 && eigen.eigenvalues()[e] > 1; --e) {
    const Eigen::VectorXd v = eigen.eigenvectors().col(e);
    std::vector<Eigen::Index> parts;
    for (Eigen::Index i = 0; i < n; ++i)
      if (std::abs(v[i]) > 0.35 * v.cwiseAbs().maxCoeff()) parts.push_back(i);
    std::sort(parts.begin(), parts.end(),
              [&](Eigen::Index a, Eigen::Index b) { return std::abs(v[a]) > std::abs(v[b]); });
    std::string words;
    for (const Eigen::Index i : parts) {
      const Direction& d = of[static_cast<std::size_t>(i)];
      words += (words.empty() ? "" : " traded against ") + d.name + " (+-" +
               Number(d.text, std::sqrt(covariance(i, i)) * d.per_unit) + ")";
    }
    weak.push_back(words);
  }
  return weak;
}

// The frame in which the mechanism is solved (hand_eye_adjustment.h), seen from the base.
RigidTransform BaseOfNominal(const PanTilt& nominal) {
  const auto sign = [](double scale) { return scale < 0 ? -1.0 : 1.0; };
  const RigidTransform pan_zero =
      Turn(nominal.pan_axis.direction.normalized(), nominal.pan_offset_deg * kRadPerDeg);
  const Eigen::Vector3d point = nominal.pan_axis.point,
                        n = sign(nominal.pan_scale) * nominal.pan_axis.direction.normalized();
  const Eigen::Vector3d tilt =
      sign(nominal.tilt_scale) * (pan_zero.linear() * nominal.tilt_axis.direction.normalized());
  const Eigen::Vector3d tilt_point = point + pan_zero.linear() * (nominal.tilt_axis.point - point);
  Eigen::Vector3d heading = tilt - n * n.dot(tilt);
  // Where the tilt axis passes the pan axis: nearest points of two lines.
  double along = n.dot(tilt_point - point);
  if (const double s = heading.squaredNorm(); s > 1e-6)
    along -= heading.dot(tilt_point - point) / s * n.dot(tilt);
  if (heading.norm() < 1e-3) heading = n.unitOrthogonal();
  heading.normalize();
  RigidTransform T = RigidTransform::Identity();
  T.linear().col(1) = -heading;
  T.linear().col(2) = n;
  T.linear().col(0) = T.linear().col(1).cross(n);
  T.translation() = point + along * n;
  return T;
}

RigidTransform BaseByConvention(const RigidTransform& T_hand_color) {
  const Eigen::Vector3d up = Eigen::Vector3d::UnitZ() * (T_hand_color.linear()(2, 1) > 0 ? -1.0 : 1.0);
  Eigen::Vector3d forward = T_hand_color.linear().col(2);
  forward -= up * up.dot(forward);
  if (forward.norm() < 1e-3) forward = Eigen::Vector3d::UnitX();
  forward.normalize();
  RigidTransform T = RigidTransform::Identity();
  T.linear().row(0) = forward.transpose();
  T.linear().row(1) = up.cross(forward).transpose();
  T.linear().row(2) = up.transpose();
  return T;
}

PanTilt InBase(const HandEyeAdjustment& problem, const std::optional<PanTilt>& nominal,
               const RigidTransform& T_base_own) {
  PanTilt ptu = nominal.value_or(PanTilt{});
  const Eigen::Vector4d& m = problem.mechanism;
  if (!nominal) ptu.pan_axis = {T_base_own.linear().col(2), T_base_own.translation()};
  const auto about = [](const PanTilt::Axis& axis, double angle_rad) {
    RigidTransform T = Turn(axis.direction.normalized(), angle_rad);
    T.translation() = axis.point - T.linear() * axis.point;
    return T;
  };
  const RigidTransform at_zero = about(ptu.pan_axis, -ptu.pan_offset_deg * kRadPerDeg) * T_base_own;
  const double pan_sign = ptu.pan_scale < 0 ? -1 : 1, tilt_sign = ptu.tilt_scale < 0 ? -1 : 1;
  ptu.pan_scale = pan_sign * m[2];
  ptu.tilt_scale = tilt_sign * m[3];
  ptu.tilt_axis.direction =
      tilt_sign * (at_zero.linear() * Eigen::Vector3d(0, -std::cos(m[1]), std::sin(m[1])));
  ptu.tilt_axis.point = at_zero * Eigen::Vector3d(m[0], 0, 0);
  ptu.T_tilt_color = about(ptu.tilt_axis, -ptu.tilt_offset_deg * kRadPerDeg) * at_zero * problem.T_hand_color;
  return ptu;
}

Session NewSession(const std::vector<Board>& boards, HeadKind kind, std::size_t views) {
  Session session{boards, {}, {}, {}, {}, {}, {}};
  session.problem.kind = kind;
  session.problem.views.resize(views);
  session.fits.resize(views);
  return session;
}

constexpr double kDeg = 1 / kRadPerDeg;

}  // namespace

Result<HandEyeResult> CalibrateHandEye(const HandEyeInput& input) {
  Session session = NewSession(input.boards, HeadKind::kPanTilt, input.views.size());
  HandEyeAdjustment& problem = session.problem;
  // Color first, whether or not the others exist.
  problem.cameras.push_back({.lens = LensOf(input.rig.color)});
  problem.cameras.push_back({.lens = input.rig.depth ? LensOf(input.rig.depth->camera) : Lens{},
                             .T_camera_color = input.rig.T_color_depth.inverse()});
  problem.cameras.push_back({.lens = input.rig.fisheye ? LensOf(*input.rig.fisheye) : Lens{},
                             .T_camera_color = input.rig.T_color_fisheye.inverse()});
  problem.cameras[0].lens_covariance = input.color_covariance;
  problem.cameras[1].lens_covariance = input.depth_covariance;
  problem.cameras[2].lens_covariance = input.fisheye_covariance;
  for (auto& camera : problem.cameras) camera.lens_expected = camera.lens.numbers;
  const std::optional<PanTilt>& nominal = input.rig.ptu;
  const double pan_scale = nominal ? std::abs(nominal->pan_scale) : 1,
               tilt_scale = nominal ? std::abs(nominal->tilt_scale) : 1;
  problem.mechanism = problem.mechanism_expected = {0, 0, pan_scale, tilt_scale};
  for (std::size_t v = 0; v < input.views.size(); ++v) {
    const HeadView& view = input.views[v];
    if (!std::isfinite(view.pan_deg) || !std::isfinite(view.tilt_deg))
      return Fail(ErrorCode::kBadInput, view.name + ": pan or tilt is not finite");
    session.names.push_back(view.name);
    session.fits[v].name = view.name;
    problem.views[v].pan_rad = view.pan_deg * kRadPerDeg;
    problem.views[v].tilt_rad = view.tilt_deg * kRadPerDeg;
    session.T_base_hand.push_back(Turn(Eigen::Vector3d::UnitZ(), pan_scale * problem.views[v].pan_rad) *
                                  Turn(-Eigen::Vector3d::UnitY(), tilt_scale * problem.views[v].tilt_rad));
    const std::vector<BoardSighting>* by_camera[] = {&view.color, &view.amplitude, &view.fisheye};
    for (std::size_t camera = 0; camera < 3; ++camera) {
      // What is left of the other cameras' errors would weigh more than their coarser pixels tell.
      if (camera > 0 && !view.color.empty()) break;
      for (const BoardSighting& sighting : *by_camera[camera]) {
        if (auto ok = CheckSighting(view.name, input.boards, sighting); !ok)
          return tl::unexpected(ok.error());
        if (problem.cameras[camera].lens.width == 0)
          return Fail(ErrorCode::kBadInput, view.name + ": the rig lacks a camera that sees a board");
        session.seen.push_back({v, camera, &sighting});
      }
    }
  }
  Eigen::Matrix3d guess;  // the camera looks along x with its x axis to the right
  guess << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  std::optional<RigidTransform> T_base_own;
  if (nominal) {
    T_base_own = BaseOfNominal(*nominal);
    PanTilt at_zero = *nominal;
    at_zero.T_world_base = T_base_own->inverse();
    guess = at_zero.TWorldColor(0, 0).linear();
  }
  if (auto ok = Begin(session, guess); !ok) return tl::unexpected(ok.error());
  if (auto ok = AdjustSession(session); !ok) return tl::unexpected(ok.error());
  if (problem.encoder_noise.maxCoeff() > kWorstNoiseRad)
    return Fail(ErrorCode::kQualityGate, "hand-eye: the encoders scatter by " +
                                             Number("%.2f deg", problem.encoder_noise.maxCoeff() * kDeg) +
                                             "; more than 0.3 is no pan-tilt head that stands still");

  if (!T_base_own) T_base_own = BaseByConvention(problem.T_hand_color);
  HandEyeResult result;
  result.ptu = InBase(problem, nominal, *T_base_own);
  for (const RigidTransform& T : problem.T_base_board) result.T_base_board.push_back(*T_base_own * T);
  result.views = session.fits;
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    result.views[v].pan_correction_deg = problem.views[v].correction[0] * kDeg;
    result.views[v].tilt_correction_deg = problem.views[v].correction[1] * kDeg;
  }
  result.pan_noise_deg = problem.encoder_noise[0] * kDeg;
  result.tilt_noise_deg = problem.encoder_noise[1] * kDeg;
  result.held = session.held;
  std::vector<Eigen::Vector2d> sweep;
  for (int pan = -2; pan <= 2; ++pan)
    for (int tilt = -2; tilt <= 2; ++tilt) sweep.push_back(Eigen::Vector2d(20 * pan, 17 * tilt) * kRadPerDeg);
  const RelativeDeviation deviation = DeviationBetween(problem, sweep);
  result.sweep_sd_deg = deviation.rotation_rad * kDeg;
  result.sweep_sd_mm = deviation.translation * 1000;
  for (const auto& sighting : problem.sightings) {
    double* noise[] = {&result.color_noise_px, &result.amplitude_noise_px, &result.fisheye_noise_px};
    if (sighting.used) *noise[sighting.camera] = problem.cameras[sighting.camera].noise_px;
  }

  const std::vector<Direction> directions{
      {"distance of the axes", kWeakM, 1000, "%.1f mm"},
      {"skew of the axes", kWeakRad, kDeg, "%.3f deg"},
      {"pan scale", kWeakRad, 100, "%.3f %%"},
      {"tilt scale", kWeakRad, 100, "%.3f %%"},
      {"camera's turn about the axes' common perpendicular", kWeakRad, kDeg, "%.3f deg"},
      {"camera's turn about the tilt axis", kWeakRad, kDeg, "%.3f deg"},
      {"camera's turn about the pan axis", kWeakRad, kDeg, "%.3f deg"},
      {"camera's place along the axes' common perpendicular", kWeakM, 1000, "%.1f mm"},
      {"camera's place along the tilt axis", kWeakM, 1000, "%.1f mm"},
      {"camera's place along the pan axis", kWeakM, 1000, "%.1f mm"}};
  result.weak = WeakDirections(problem.covariance, directions);
  const Eigen::Vector3d place = problem.T_hand_color.translation();
  const double values[] = {problem.mechanism[0],
                           problem.mechanism[1],
                           problem.mechanism[2],
                           problem.mechanism[3],
                           place.x(),
                           place.y(),
                           place.z()};
  for (std::size_t i = 0; i < directions.size(); ++i) {
    if (i >= 4 && i < 7) continue;  // turns: their values are T_tilt_color's
    const Direction& d = directions[i];
    const bool scale = i == 2 || i == 3;
    const double per_unit = scale ? 1 : d.per_unit;
    const auto at = static_cast<Eigen::Index>(i);
    result.figures.push_back({d.name, values[i < 4 ? i : i - 3] * per_unit,
                              std::sqrt(problem.covariance(at, at)) * per_unit,
                              scale    ? "1"
                              : i == 1 ? "deg"
                                       : "mm"});
  }
  return result;
}

Result<RobotHandEyeResult> CalibrateRobotHandEye(const RobotHandEyeInput& input) {
  Session session = NewSession(input.boards, HeadKind::kRobot, input.views.size());
  HandEyeAdjustment& problem = session.problem;
  problem.cameras.push_back({.lens = LensOf(input.camera)});
  problem.encoder_noise = {0.1 * kRadPerDeg, 0.001};
  for (std::size_t v = 0; v < input.views.size(); ++v) {
    const RobotView& view = input.views[v];
    if (!view.T_base_hand.matrix().allFinite())
      return Fail(ErrorCode::kBadInput, view.name + ": the hand's pose is not finite");
    session.names.push_back(view.name);
    session.fits[v].name = view.name;
    problem.views[v].T_base_hand = view.T_base_hand;
    session.T_base_hand.push_back(view.T_base_hand);
    for (const BoardSighting& sighting : view.sightings) {
      if (auto ok = CheckSighting(view.name, input.boards, sighting); !ok) return tl::unexpected(ok.error());
      session.seen.push_back({v, 0, &sighting});
    }
  }
  if (auto ok = Begin(session, Eigen::Matrix3d::Identity()); !ok) return tl::unexpected(ok.error());
  if (auto ok = AdjustSession(session); !ok) return tl::unexpected(ok.error());

  RobotHandEyeResult result;
  result.T_hand_color = problem.T_hand_color;
  result.T_base_board = problem.T_base_board;
  result.views = session.fits;
  for (std::size_t v = 0; v < problem.views.size(); ++v) {
    result.views[v].rotation_correction_deg = problem.views[v].correction.head<3>().norm() * kDeg;
    result.views[v].translation_correction_mm = problem.views[v].correction.tail<3>().norm() * 1000;
  }
  result.rotation_noise_deg = problem.encoder_noise[0] * kDeg;
  result.translation_noise_mm = problem.encoder_noise[1] * 1000;
  result.noise_px = problem.cameras[0].noise_px;
  std::vector<Direction> directions;
  for (const char* axis : {"x", "y", "z"})
    directions.push_back({std::string("camera's turn about the hand's ") + axis, kWeakRad, kDeg, "%.3f deg"});
  for (const char* axis : {"x", "y", "z"})
    directions.push_back({std::string("camera's place along the hand's ") + axis, kWeakM, 1000, "%.1f mm"});
  const Eigen::MatrixXd covariance = problem.covariance.bottomRightCorner(6, 6);
  result.weak = WeakDirections(covariance, directions);
  for (Eigen::Index i = 0; i < 6; ++i) {
    const Direction& d = directions[static_cast<std::size_t>(i)];
    const double value = i < 3 ? 0 : problem.T_hand_color.translation()[i - 3] * 1000;
    if (i >= 3) result.figures.push_back({d.name, value, std::sqrt(covariance(i, i)) * 1000, "mm"});
  }
  return result;
}

}  // namespace mixstage
