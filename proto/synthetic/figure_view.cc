// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/figure_view.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace mixstage {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr double kProbeX0 = 2.6, kProbeX1 = 4.6, kProbeY0 = -2.6, kProbeY1 = 1.9;
constexpr double kProbeZ[2] = {0.35, 1.65};
constexpr int kProbeRays = 96;

void Store(const Vector3d& from, float* to) {
  for (int c = 0; c < 3; ++c) to[c] = static_cast<float>(from[c]);
}

SoftLamp LampOf(const SyntheticLamp& light) {
  SoftLamp lamp{};
  Store(light.center, lamp.center);
  lamp.radius = static_cast<float>(light.DiscRadius());
  return lamp;
}

void PointsOf(const SyntheticLamp& light, BodyLight::Point* points) {
  const double area = 4 * light.half_u.norm() * light.half_v.norm();
  for (int i = 0; i < kLampPoints; ++i) {
    const Vector3d at = light.center + (i % 2 - 0.5) * light.half_u + (i / 2 - 0.5) * light.half_v;
    Store(at, points[i].position);
    Store(light.normal, points[i].normal);
    Store(light.radiance.cast<double>() * (area / kLampPoints / std::numbers::pi), points[i].power);
  }
}

}  // namespace

void ViewFigure(const Figure& figure, const PinholeCamera& camera, const RigidTransform& T_world_camera,
                int margin_px, FigureView& view) {
  view.count = figure.count;
  view.u0 = view.v0 = INT_MAX;
  view.u1 = view.v1 = -1;
  const RigidTransform T_camera_world = T_world_camera.inverse();
  const Vector3d center = T_world_camera.translation();
  for (int i = 0; i < figure.count; ++i) {
    const BodyPart& body = figure.parts[static_cast<std::size_t>(i)];
    PartView& part = view.parts[static_cast<std::size_t>(i)];
    const RoundCone& cone = body.cone;
    for (int k = 0; k < 9; ++k) part.to_local[k] = static_cast<float>(cone.to_local(k / 3, k % 3));
    Store(cone.to_local * (cone.a - center), part.origin);
    part.length = static_cast<float>(cone.length_m);
    part.radius_a = static_cast<float>(cone.radius_a_m);
    part.radius_b = static_cast<float>(cone.radius_b_m);
    part.slope = static_cast<float>(cone.Slope());
    part.infrared = body.infrared;
    for (int c = 0; c < 3; ++c) part.albedo[c] = body.albedo[c];
    const Eigen::AlignedBox3d box = cone.Bounds();
    // Rays start half a metre before the part.
    part.near_m = static_cast<float>((T_camera_world * box.center()).z() - 0.5);
    double u0 = INFINITY;
    double v0 = INFINITY;
    double u1 = -INFINITY;
    double v1 = -INFINITY;
    bool whole_picture = false;
    for (int corner = 0; corner < 8; ++corner) {
      const Vector3d p = box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(corner));
      const auto pixel = camera.Project(T_camera_world * p);
      if (!pixel) {
        // Behind the camera or beyond its lens: seen only where the part itself may be.
        whole_picture = true;
        break;
      }
      u0 = std::min(u0, pixel->x());
      u1 = std::max(u1, pixel->x());
      v0 = std::min(v0, pixel->y());
      v1 = std::max(v1, pixel->y());
    }
    const bool behind = (T_camera_world * box.center()).z() + 0.5 * box.diagonal().norm() < 0.05;
    if (whole_picture) {
      u0 = v0 = 0;
      u1 = behind ? -1 : camera.width - 1;
      v1 = behind ? -1 : camera.height - 1;
    }
    auto cut = [](double x, int size) {
      return static_cast<int>(std::clamp(x, -1.0, static_cast<double>(size)));
    };
    part.u0 = std::max(0, cut(std::floor(u0) - margin_px, camera.width));
    part.v0 = std::max(0, cut(std::floor(v0) - margin_px, camera.height));
    part.u1 = std::min(camera.width - 1, cut(std::ceil(u1) + margin_px, camera.width));
    part.v1 = std::min(camera.height - 1, cut(std::ceil(v1) + margin_px, camera.height));
    if (part.u0 > part.u1 || part.v0 > part.v1) {
      part.u0 = part.v0 = 1;
      part.u1 = part.v1 = 0;
      continue;
    }
    view.u0 = std::min(view.u0, part.u0);
    view.v0 = std::min(view.v0, part.v0);
    view.u1 = std::max(view.u1, part.u1);
    view.v1 = std::max(view.v1, part.v1);
  }
}

void CastersOf(const Figure& figure, Casters& casters) {
  casters.count = 0;
  for (int i = 0; i < figure.count; ++i) {
    const BodyPart& part = figure.parts[static_cast<std::size_t>(i)];
    if (part.shadowing != Shadowing::kCasts) continue;
    const RoundCone& cone = part.cone;
    Caster& caster = casters.casters[static_cast<std::size_t>(casters.count++)];
    const Eigen::Matrix3d from_local = cone.to_local.inverse();
    const Vector3d ab = from_local * Vector3d(0, 0, cone.length_m);
    Store(cone.a, caster.a);
    Store(ab, caster.ab);
    caster.length2 = static_cast<float>(ab.squaredNorm());
    const double radius = 0.5 * (cone.radius_a_m + cone.radius_b_m);
    const double wide = radius * from_local.col(0).norm();
    const double deep = radius * from_local.col(1).norm();
    caster.room_radius = static_cast<float>(std::sqrt(wide * deep));
    const double thin = std::min(wide, deep) * std::min(cone.radius_a_m, cone.radius_b_m) / radius;
    caster.body_radius = static_cast<float>(0.88 * thin);
  }
}

FigureLight::FigureLight(const RoomLight& light) : probes_(static_cast<std::size_t>(kX * kY * kZ * 6)) {
  PointsOf(light.window(), lamps_.window);
  PointsOf(light.softbox(), lamps_.softbox);
  lamps_.window_lamp = LampOf(light.window());
  lamps_.softbox_lamp = LampOf(light.softbox());
  for (int z = 0; z < kZ; ++z) lamps_.ambient_z[z] = static_cast<float>(kProbeZ[z]);
  cv::parallel_for_(cv::Range(0, static_cast<int>(probes_.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) {
      const int face = i % 6;
      const int x = i / 6 % kX;
      const int y = i / 6 / kX % kY;
      const int z = i / 6 / kX / kY;
      const Vector3d p(kProbeX0 + (kProbeX1 - kProbeX0) * x / (kX - 1),
                       kProbeY0 + (kProbeY1 - kProbeY0) * y / (kY - 1), kProbeZ[z]);
      const Vector3d normal = (face % 2 == 0 ? 1.0 : -1.0) * Vector3d::Unit(face / 2);
      const auto seed = static_cast<std::uint32_t>(i + 1000);
      probes_[static_cast<std::size_t>(i)] =
          light.Bounced(p, normal, kProbeRays, seed) + light.Lamp(p, normal, seed);
    }
  });
}

void FigureLight::At(const Eigen::Vector2d& body, BodyLight& out) const {
  const double gx = std::clamp((body.x() - kProbeX0) / (kProbeX1 - kProbeX0), 0.0, 1.0) * (kX - 1);
  const double gy = std::clamp((body.y() - kProbeY0) / (kProbeY1 - kProbeY0), 0.0, 1.0) * (kY - 1);
  const int x = std::min(static_cast<int>(gx), kX - 2);
  const int y = std::min(static_cast<int>(gy), kY - 2);
  const auto fx = static_cast<float>(gx - x);
  const auto fy = static_cast<float>(gy - y);
  out = lamps_;
  for (int z = 0; z < kZ; ++z) {
    for (int face = 0; face < 6; ++face) {
      auto probe = [&](int i, int j) -> const Vector3f& {
        return probes_[static_cast<std::size_t>(((z * kY + j) * kX + i) * 6 + face)];
      };
      const Vector3f mean = (1 - fy) * ((1 - fx) * probe(x, y) + fx * probe(x + 1, y)) +
                            fy * ((1 - fx) * probe(x, y + 1) + fx * probe(x + 1, y + 1));
      for (int c = 0; c < 3; ++c) out.ambient[z][face][c] = mean[c];
    }
  }
}

}  // namespace mixstage
