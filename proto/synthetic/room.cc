// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/room.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "proto/base/check.h"
#include "proto/synthetic/room_plan.h"

namespace mixstage {
namespace {

using Eigen::Vector3d;
namespace plan = room_plan;

struct Meeting {
  double t = std::numeric_limits<double>::infinity();
  Vector3d normal = Vector3d::UnitZ();
};

constexpr double kNear = 1e-6;  // m: what a ray leaves is not what it meets

bool MeetBox(const Solid& s, const Ray& ray, Meeting& best) {
  const Vector3d o = ray.origin - s.center;
  const Vector3d d = ray.direction;
  const Vector3d lo(s.cos_yaw * o.x() + s.sin_yaw * o.y(), -s.sin_yaw * o.x() + s.cos_yaw * o.y(), o.z());
  const Vector3d ld(s.cos_yaw * d.x() + s.sin_yaw * d.y(), -s.sin_yaw * d.x() + s.cos_yaw * d.y(), d.z());
  double enter = -INFINITY;
  double leave = INFINITY;
  int axis = 0;
  for (int i = 0; i < 3; ++i) {
    if (std::abs(ld[i]) < 1e-12) {
      if (std::abs(lo[i]) > s.half[i]) return false;
      continue;
    }
    const double inv = 1 / ld[i];
    const double middle = -lo[i] * inv;
    const double reach = s.half[i] * std::abs(inv);
    if (middle - reach > enter) {
      enter = middle - reach;
      axis = i;
    }
    leave = std::min(leave, middle + reach);
  }
  if (enter > leave || enter <= kNear || enter >= best.t) return false;
  best.t = enter;
  Vector3d n = Vector3d::Zero();
  n[axis] = ld[axis] > 0 ? -1 : 1;
  best.normal = Vector3d(s.cos_yaw * n.x() - s.sin_yaw * n.y(), s.sin_yaw * n.x() + s.cos_yaw * n.y(), n.z());
  return true;
}

// An upright cone frustum with both discs: rho = r0 + slope z for z in [0, height].
bool MeetFrustum(const Solid& s, const Ray& ray, Meeting& best) {
  const Vector3d o = ray.origin - s.center;
  const Vector3d& d = ray.direction;
  const double r0 = s.half.x();
  const double r1 = s.half.y();
  const double height = s.half.z();
  const double slope = (r1 - r0) / height;
  bool met = false;
  const double rim = r0 + slope * o.z();
  const double A = d.x() * d.x() + d.y() * d.y() - slope * slope * d.z() * d.z();
  const double B = o.x() * d.x() + o.y() * d.y() - rim * slope * d.z();
  const double C = o.x() * o.x() + o.y() * o.y() - rim * rim;
  const double h = B * B - A * C;
  if (h > 0 && A != 0) {
    const double t = (-B - std::sqrt(h)) / A;
    const double z = o.z() + t * d.z();
    if (t > kNear && t < best.t && z >= 0 && z <= height) {
      best.t = t;
      best.normal = Vector3d(o.x() + t * d.x(), o.y() + t * d.y(), -slope * (r0 + slope * z)).normalized();
      met = true;
    }
  }
  if (d.z() != 0) {
    for (const auto& [level, radius] : {std::pair(0.0, r0), std::pair(height, r1)}) {
      const double t = (level - o.z()) / d.z();
      const double x = o.x() + t * d.x();
      const double y = o.y() + t * d.y();
      if (t > kNear && t < best.t && x * x + y * y <= radius * radius) {
        best.t = t;
        best.normal = Vector3d(0, 0, d.z() > 0 ? -1 : 1);
        met = true;
      }
    }
  }
  return met;
}

bool Meet(const Solid& s, const Ray& ray, Meeting& best) {
  switch (s.kind) {
    case Solid::Kind::kBox:
      return MeetBox(s, ray, best);
    case Solid::Kind::kFrustum:
      return MeetFrustum(s, ray, best);
    case Solid::Kind::kRoundCone:
      break;
  }
  const auto t = s.cone.Intersect(ray.origin, ray.direction, kNear);
  if (!t || *t >= best.t) return false;
  best.t = *t;
  best.normal = s.cone.Normal(ray.origin + *t * ray.direction);
  return true;
}

// Where a ray enters a box, infinite where it misses it or enters beyond `limit`.
double Entry(const Eigen::AlignedBox3d& box, const Vector3d& origin, const Vector3d& inverse, double limit) {
  double enter = 0;
  double leave = limit;
  for (int i = 0; i < 3; ++i) {
    const double a = (box.min()[i] - origin[i]) * inverse[i];
    const double b = (box.max()[i] - origin[i]) * inverse[i];
    enter = std::max(enter, std::min(a, b));
    leave = std::min(leave, std::max(a, b));
  }
  return enter <= leave ? enter : INFINITY;
}

// The shell, seen from inside, with the window's recess.
Room::Found MeetShell(const Ray& ray) {
  Room::Found found;
  found.range_m = std::numeric_limits<double>::infinity();
  auto offer = [&](int axis, double level, double inward, Surface surface) {
    const double d = ray.direction[axis];
    if (d * inward >= 0) return;
    const double t = (level - ray.origin[axis]) / d;
    if (t > kNear && t < found.range_m) {
      found.range_m = t;
      found.normal = inward * Vector3d::Unit(axis);
      found.surface = surface;
    }
  };
  offer(2, 0, 1, Surface::kFloor);
  offer(2, plan::kCeilingZ, -1, Surface::kCeiling);
  offer(0, plan::kBackX, -1, Surface::kWallBack);
  offer(0, plan::kFrontX, 1, Surface::kWallFront);
  offer(1, plan::kRightY, 1, Surface::kWallRight);
  offer(1, plan::kLeftY, -1, Surface::kWallLeft);
  const Vector3d p = ray.origin + found.range_m * ray.direction;
  if (found.surface == Surface::kCeiling && std::abs(p.x() - plan::kSoftboxX) < plan::kSoftboxHalf &&
      std::abs(p.y() - plan::kSoftboxY) < plan::kSoftboxHalf)
    found.surface = Surface::kSoftbox;
  const bool through_window = found.surface == Surface::kWallLeft && p.x() > plan::kWindowX0 &&
                              p.x() < plan::kWindowX1 && p.z() > plan::kWindowZ0 && p.z() < plan::kWindowZ1;
  if (through_window || ray.origin.y() > plan::kLeftY) {
    found.range_m = std::numeric_limits<double>::infinity();
    offer(1, plan::kPaneY, -1, Surface::kPane);
    offer(0, plan::kWindowX0, 1, Surface::kPaint);
    offer(0, plan::kWindowX1, -1, Surface::kPaint);
    offer(2, plan::kWindowZ0, 1, Surface::kPaint);
    offer(2, plan::kWindowZ1, -1, Surface::kPaint);
    if (ray.direction.y() < 0) {  // out of the recess into the room
      const double t = (plan::kLeftY - 1e-9 - ray.origin.y()) / ray.direction.y();
      if (t < found.range_m) {
        Room::Found inside = MeetShell({ray.origin + t * ray.direction, ray.direction});
        inside.range_m += t;
        return inside;
      }
    }
  }
  return found;
}

}  // namespace

Eigen::AlignedBox3d Solid::Bounds() const {
  if (kind == Kind::kRoundCone) return cone.Bounds();
  if (kind == Kind::kFrustum) {
    const double r = std::max(half.x(), half.y());
    return {center - Vector3d(r, r, 0), center + Vector3d(r, r, half.z())};
  }
  const Vector3d reach(std::abs(cos_yaw) * half.x() + std::abs(sin_yaw) * half.y(),
                       std::abs(sin_yaw) * half.x() + std::abs(cos_yaw) * half.y(), half.z());
  return {center - reach, center + reach};
}

Room::Room() : solids_(Furniture()) {
  order_.resize(solids_.size());
  for (std::size_t i = 0; i < order_.size(); ++i) order_[i] = static_cast<int>(i);
  nodes_.resize(1);
  Build(0, 0, static_cast<int>(order_.size()));
}

void Room::Build(int node, int first, int count) {
  Eigen::AlignedBox3d box;
  for (int i = first; i < first + count; ++i) {
    box.extend(solids_[static_cast<std::size_t>(order_[static_cast<std::size_t>(i)])].Bounds());
  }
  nodes_[static_cast<std::size_t>(node)].box = box;
  if (count <= 2) {
    nodes_[static_cast<std::size_t>(node)].first = first;
    nodes_[static_cast<std::size_t>(node)].count = count;
    return;
  }
  // The split of least expected cost: the halves' surfaces times how many solids are in them.
  const auto begin = order_.begin() + first;
  auto bounds = [&](int k) {
    return solids_[static_cast<std::size_t>(order_[static_cast<std::size_t>(first + k)])].Bounds();
  };
  auto sort_along = [&](int axis) {
    std::sort(begin, begin + count, [&](int x, int y) {
      const double cx = solids_[static_cast<std::size_t>(x)].Bounds().center()[axis];
      const double cy = solids_[static_cast<std::size_t>(y)].Bounds().center()[axis];
      return cx != cy ? cx < cy : x < y;
    });
  };
  auto surface = [](const Eigen::AlignedBox3d& b) {
    const Vector3d size = b.sizes();
    return size.x() * size.y() + size.y() * size.z() + size.z() * size.x();
  };
  double best_cost = std::numeric_limits<double>::infinity();
  int best_axis = 0;
  int best_left = count / 2;
  std::vector<double> right_surface(static_cast<std::size_t>(count));
  for (int axis = 0; axis < 3; ++axis) {
    sort_along(axis);
    Eigen::AlignedBox3d grown;
    for (int k = count - 1; k > 0; --k) {
      grown.extend(bounds(k));
      right_surface[static_cast<std::size_t>(k)] = surface(grown);
    }
    grown.setEmpty();
    for (int k = 1; k < count; ++k) {
      grown.extend(bounds(k - 1));
      const double cost = surface(grown) * k + right_surface[static_cast<std::size_t>(k)] * (count - k);
      if (cost < best_cost) {
        best_cost = cost;
        best_axis = axis;
        best_left = k;
      }
    }
  }
  sort_along(best_axis);
  const int children = static_cast<int>(nodes_.size());
  nodes_.resize(nodes_.size() + 2);
  nodes_[static_cast<std::size_t>(node)].first = children;
  Build(children, first, best_left);
  Build(children + 1, first + best_left, count - best_left);
}

// Calls visit(solid index) for the solids whose boxes the ray meets before limit_m (which visit may shorten);
// visit returns true to stop.
template <typename Visit>
void Room::Walk(const Ray& ray, const double& limit_m, Visit visit) const {
  const Vector3d inverse = ray.direction.cwiseInverse();
  struct Place {
    int node;
    double entry;
  };
  Place stack[64];
  int size = 0;
  if (const double entry = Entry(nodes_[0].box, ray.origin, inverse, limit_m); entry < limit_m)
    stack[size++] = {0, entry};
  while (size > 0) {
    const Place place = stack[--size];
    if (place.entry >= limit_m) continue;
    const Node& node = nodes_[static_cast<std::size_t>(place.node)];
    if (node.count == 0) {
      MIX_CHECK(size + 2 <= static_cast<int>(std::size(stack)));
      const auto child = static_cast<std::size_t>(node.first);
      const double a = Entry(nodes_[child].box, ray.origin, inverse, limit_m);
      const double b = Entry(nodes_[child + 1].box, ray.origin, inverse, limit_m);
      const bool a_first = a <= b;  // the nearer one goes on top
      if (std::isfinite(a_first ? b : a)) stack[size++] = {node.first + (a_first ? 1 : 0), a_first ? b : a};
      if (std::isfinite(a_first ? a : b)) stack[size++] = {node.first + (a_first ? 0 : 1), a_first ? a : b};
      continue;
    }
    for (int i = node.first; i < node.first + node.count; ++i) {
      if (visit(order_[static_cast<std::size_t>(i)])) return;
    }
  }
}

Room::Found Room::Trace(const Ray& ray) const {
  Found found = MeetShell(ray);
  Meeting best;
  best.t = found.range_m;
  Walk(ray, best.t, [&](int i) {
    if (Meet(solids_[static_cast<std::size_t>(i)], ray, best)) found.solid = i;
    return false;
  });
  if (found.solid >= 0) {
    found.range_m = best.t;
    found.normal = best.normal;
    found.surface = solids_[static_cast<std::size_t>(found.solid)].surface;
  }
  return found;
}

bool Room::Blocked(const Ray& ray, double range_m, Occluders occluders) const {
  bool blocked = false;
  Walk(ray, range_m, [&](int i) {
    const Solid& solid = solids_[static_cast<std::size_t>(i)];
    Meeting best;
    best.t = range_m;
    blocked = (occluders == Occluders::kAll || solid.casts_lamp_shadow) && Meet(solid, ray, best);
    return blocked;
  });
  return blocked;
}

}  // namespace mixstage
