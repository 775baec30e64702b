// SPDX-License-Identifier: Apache-2.0
#include "proto/geometry/sweep_grid.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kDegPerRad = 180 / std::numbers::pi;
constexpr double kFallback_deg = 10;  // of a lens that has no ray at the middle of its edge

double Angle_deg(const PinholeCamera& c, const Vector2d& one_edge, const Vector2d& other_edge) {
  const auto a = c.Unproject(one_edge);
  const auto b = c.Unproject(other_edge);
  if (!a || !b) return kFallback_deg;
  const Vector3d p(a->x(), a->y(), 1);
  const Vector3d q(b->x(), b->y(), 1);
  return std::atan2(p.cross(q).norm(), p.dot(q)) * kDegPerRad;
}

Vector2d FieldOfView_deg(const PinholeCamera& c) {
  const double right = c.width - 0.5;
  const double bottom = c.height - 0.5;
  return {Angle_deg(c, {-0.5, c.cy}, {right, c.cy}), Angle_deg(c, {c.cx, -0.5}, {c.cx, bottom})};
}

// Stops that cover from .. to with pictures `field` wide.
std::vector<double> Stops(double from_deg, double to_deg, double field_deg) {
  const double span_deg = to_deg - from_deg;
  const double first_deg = from_deg + 0.5 * field_deg;
  const double way_deg = span_deg - field_deg;
  if (way_deg <= 0) return {0.5 * (from_deg + to_deg)};
  const int steps = static_cast<int>(std::ceil(way_deg / (0.5 * field_deg) - 1e-9));
  std::vector<double> stops;
  for (int i = 0; i <= steps; ++i) stops.push_back(first_deg + way_deg * i / steps);
  return stops;
}

std::vector<double> WholeTurn(double from_deg, double field_deg) {
  const int count = static_cast<int>(std::ceil(360 / (0.5 * field_deg) - 1e-9));
  std::vector<double> stops;
  for (int i = 0; i < count; ++i) stops.push_back(from_deg + 360.0 * (i + 0.5) / count);
  return stops;
}

}  // namespace

Vector2d SharedFieldOfView_deg(const Rig& rig) {
  Vector2d field = FieldOfView_deg(rig.color);
  if (rig.depth && !rig.registered) field = field.cwiseMin(FieldOfView_deg(rig.depth->camera));
  return field;
}

Result<std::vector<HeadPosition>> SweepGrid(const Rig& rig, const SweepArea& area) {
  const double pan_span = area.pan_to_deg - area.pan_from_deg;
  const double tilt_span = area.tilt_to_deg - area.tilt_from_deg;
  if (!(pan_span >= 0 && pan_span <= 360 && std::abs(area.pan_from_deg) <= 360)) {
    return Fail(ErrorCode::kInvalidConfig,
                "the pan of a sweep is A:B with A <= B, at most 360 degrees apart");
  }
  if (!(tilt_span >= 0 && area.tilt_from_deg >= -90 && area.tilt_to_deg <= 90)) {
    return Fail(ErrorCode::kInvalidConfig, "the tilt of a sweep is C:D with C <= D, within +-90 degrees");
  }
  const Vector2d field = SharedFieldOfView_deg(rig);
  const std::vector<double> pans = pan_span >= 360 ? WholeTurn(area.pan_from_deg, field.x())
                                                   : Stops(area.pan_from_deg, area.pan_to_deg, field.x());
  std::vector<double> tilts = Stops(area.tilt_from_deg, area.tilt_to_deg, field.y());
  std::reverse(tilts.begin(), tilts.end());
  std::vector<HeadPosition> grid;
  for (std::size_t row = 0; row < tilts.size(); ++row) {
    for (std::size_t i = 0; i < pans.size(); ++i)
      grid.push_back({pans[row % 2 == 0 ? i : pans.size() - 1 - i], tilts[row]});
  }
  return grid;
}

}  // namespace mixstage
