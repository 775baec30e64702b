// SPDX-License-Identifier: Apache-2.0
#include "server/environment/registration.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;

template <typename T>
using Vec3 = Eigen::Matrix<T, 3, 1>;
template <typename T>
using Mat3 = Eigen::Matrix<T, 3, 3>;

template <typename T>
struct Pose {
  Mat3<T> R;
  Vec3<T> t;
  Pose operator*(const Pose& o) const { return {R * o.R, R * o.t + t}; }
  Vec3<T> operator*(const Vec3<T>& p) const { return R * p + t; }
  [[nodiscard]] Pose Inverse() const { return {R.transpose(), -(R.transpose() * t)}; }
};

template <typename T>
Pose<T> Cast(const RigidTransform& P) {
  return {P.linear().cast<T>(), P.translation().cast<T>()};
}

// A small motion: rotation vector, translation.
template <typename T>
Pose<T> Motion(const T* x) {
  Pose<T> p;
  ceres::AngleAxisToRotationMatrix(x, p.R.data());  // column-major, as Eigen's
  p.t = Vec3<T>(x[3], x[4], x[5]);
  return p;
}

template <typename T>
Vec3<T> RotationVector(const Mat3<T>& R) {
  Vec3<T> v;
  ceres::RotationMatrixToAngleAxis(R.data(), v.data());
  return v;
}

struct MatchCost {
  RigidTransform T_from, T_to;  // start
  Eigen::Vector3d p_from;
  Eigen::Vector2d at_to;
  double weight;

  template <typename T>
  bool operator()(const T* from, const T* to, T* residual) const {
    const Vec3<T> p_world = Cast<T>(T_from) * (Motion(from) * Vec3<T>(p_from.cast<T>()));
    const Vec3<T> p = (Cast<T>(T_to) * Motion(to)).Inverse() * p_world;
    residual[0] = (p.x() / p.z() - at_to.x()) * weight;
    residual[1] = (p.y() / p.z() - at_to.y()) * weight;
    return true;
  }
};

// Pan axis: rotation vector, shift; tilt axis: the same; mount: motion; scales: 20 numbers, all small.
constexpr int kUnit = 20;

template <typename T>
Pose<T> AboutLine(const PanTilt::Axis& axis, const T* x, const T& angle_rad) {
  Mat3<T> turn;
  ceres::AngleAxisToRotationMatrix(x, turn.data());
  const Vec3<T> direction = turn * axis.direction.normalized().cast<T>();
  const Vec3<T> point = axis.point.cast<T>() + Vec3<T>(x[3], x[4], x[5]);
  const Vec3<T> v = direction * angle_rad;
  Pose<T> p;
  ceres::AngleAxisToRotationMatrix(v.data(), p.R.data());
  p.t = point - p.R * point;
  return p;
}

template <typename T>
Pose<T> UnitPose(const PanTilt& u, const ViewAngles& a, const T* unit, const T* reading) {
  const T pan =
      ((T(u.pan_scale) + unit[18]) * T(a.pan_deg) + T(u.pan_offset_deg)) * T(kRadPerDeg) + reading[0];
  const T tilt =
      ((T(u.tilt_scale) + unit[19]) * T(a.tilt_deg) + T(u.tilt_offset_deg)) * T(kRadPerDeg) + reading[1];
  return Cast<T>(u.T_world_base) * AboutLine(u.pan_axis, unit, pan) * AboutLine(u.tilt_axis, unit + 6, tilt) *
         Cast<T>(u.T_tilt_color) * Motion(unit + 12);
}

struct UnitCost {
  PanTilt unit;
  ViewAngles angles;
  RigidTransform start;
  double per_rad, per_m;

  template <typename T>
  bool operator()(const T* view, const T* x, const T* reading, T* residual) const {
    const Pose<T> off = UnitPose(unit, angles, x, reading).Inverse() * Cast<T>(start) * Motion(view);
    const Vec3<T> turn = RotationVector<T>(off.R);
    for (int k = 0; k < 3; ++k) {
      residual[k] = turn[k] * per_rad;
      residual[k + 3] = off.t[k] * per_m;
    }
    return true;
  }
};

struct ListedCost {
  RigidTransform listed, start;
  double per_rad, per_m;

  template <typename T>
  bool operator()(const T* view, T* residual) const {
    const Pose<T> off = Cast<T>(listed).Inverse() * Cast<T>(start) * Motion(view);
    const Vec3<T> turn = RotationVector<T>(off.R);
    for (int k = 0; k < 3; ++k) {
      residual[k] = turn[k] * per_rad;
      residual[k + 3] = off.t[k] * per_m;
    }
    return true;
  }
};

template <int kSize>
struct PriorCost {
  std::array<double, kSize> per;
  template <typename T>
  bool operator()(const T* x, T* residual) const {
    for (std::size_t k = 0; k < kSize; ++k) residual[k] = x[k] * per[k];
    return true;
  }
};

RigidTransform Applied(const RigidTransform& start, const double* x) {
  const Pose<double> p = Cast<double>(start) * Motion(x);
  RigidTransform T = RigidTransform::Identity();
  T.linear() = Eigen::Quaterniond(p.R).normalized().toRotationMatrix();
  T.translation() = p.t;
  return T;
}

PanTilt Refined(const PanTilt& u, const double* x) {
  PanTilt out = u;
  auto axis = [](const PanTilt::Axis& a, const double* v) {
    Mat3<double> turn;
    ceres::AngleAxisToRotationMatrix(v, turn.data());
    return PanTilt::Axis{turn * a.direction, a.point + Eigen::Vector3d(v[3], v[4], v[5])};
  };
  out.pan_axis = axis(u.pan_axis, x);
  out.tilt_axis = axis(u.tilt_axis, x + 6);
  out.T_tilt_color = Applied(u.T_tilt_color, x + 12);
  out.pan_scale += x[18];
  out.tilt_scale += x[19];
  return out;
}

}  // namespace

Registration RefinePoses(const std::vector<ViewMatch>& matches, const PinholeCamera& camera,
                         const std::vector<RigidTransform>& start, const std::vector<RigidTransform>& listed,
                         const std::optional<PanTilt>& ptu, const std::vector<ViewAngles>& angles,
                         const RegistrationConfig& config) {
  const std::size_t n = start.size();
  MIX_CHECK(listed.size() == n && (!ptu || angles.size() == n));
  std::vector<std::array<double, 6>> views(n, std::array<double, 6>{});
  std::vector<std::array<double, 2>> readings(n, std::array<double, 2>{});
  std::array<double, kUnit> unit{};
  ceres::Problem problem;
  const double f = 0.5 * (camera.fx + camera.fy);
  for (const ViewMatch& m : matches) {
    const auto i = static_cast<std::size_t>(m.from), j = static_cast<std::size_t>(m.to);
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<MatchCost, 2, 6, 6>(
                                 new MatchCost{start[i], start[j], m.p_from, m.at_to, f / config.match_px}),
                             new ceres::CauchyLoss(3.0), views[i].data(), views[j].data());
  }
  if (ptu) {
    for (std::size_t i = 0; i < n; ++i) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<UnitCost, 6, 6, kUnit, 2>(new UnitCost{
              *ptu, angles[i], start[i], 1 / (config.wobble_deg * kRadPerDeg), 1 / config.wobble_m}),
          nullptr, views[i].data(), unit.data(), readings[i].data());
      const double per = 1 / (config.encoder_deg * kRadPerDeg);
      // A reading that is a degree off may not pull the unit's axes.
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<PriorCost<2>, 2, 2>(new PriorCost<2>{{per, per}}),
          new ceres::CauchyLoss(3.0), readings[i].data());
    }
    PriorCost<kUnit> prior{};
    const double turn = 1 / (config.axis_deg * kRadPerDeg), shift = 1 / config.axis_m;
    for (std::size_t block = 0; block < 3; ++block) {
      for (std::size_t k = 0; k < 3; ++k) {
        prior.per[6 * block + k] = turn;
        prior.per[6 * block + 3 + k] = shift;
      }
    }
    prior.per[18] = prior.per[19] = 1 / config.scale;
    problem.AddResidualBlock(
        new ceres::AutoDiffCostFunction<PriorCost<kUnit>, kUnit, kUnit>(new PriorCost<kUnit>(prior)), nullptr,
        unit.data());
  } else {
    for (std::size_t i = 0; i < n; ++i) {
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<ListedCost, 6, 6>(
              new ListedCost{listed[i], start[i], 1 / (config.pose_deg * kRadPerDeg), 1 / config.pose_m}),
          nullptr, views[i].data());
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 25;
  options.num_threads = 2;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  Registration out;
  if (ptu) out.ptu = Refined(*ptu, unit.data());
  std::vector<std::vector<double>> residuals(n);
  for (std::size_t i = 0; i < n; ++i) out.T_world_color.push_back(Applied(start[i], views[i].data()));
  for (const ViewMatch& m : matches) {
    const auto i = static_cast<std::size_t>(m.from), j = static_cast<std::size_t>(m.to);
    const Eigen::Vector3d p = out.T_world_color[j].inverse() * (out.T_world_color[i] * m.p_from);
    const double miss = f * (p.head<2>() / p.z() - m.at_to).norm();
    residuals[i].push_back(miss);
    residuals[j].push_back(miss);
  }
  for (std::size_t i = 0; i < n; ++i) {
    auto& r = residuals[i];
    out.matches.push_back(static_cast<int>(r.size()));
    out.rms_px.push_back(0);
    if (!r.empty()) {
      const auto middle = r.begin() + static_cast<std::ptrdiff_t>(r.size() / 2);
      std::nth_element(r.begin(), middle, r.end());
      out.rms_px.back() = *middle / 0.8326;  // the median of a two-dimensional deviation is 0.83 of its rms
    }
    const RigidTransform base = ptu ? out.ptu->TWorldColor(angles[i].pan_deg, angles[i].tilt_deg) : listed[i];
    const Eigen::AngleAxisd turn((base.inverse() * out.T_world_color[i]).linear());
    out.moved_deg.push_back(std::abs(turn.angle()) / kRadPerDeg);
  }
  return out;
}

}  // namespace mixstage
