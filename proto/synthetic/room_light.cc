// SPDX-License-Identifier: Apache-2.0
#include "proto/synthetic/room_light.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "proto/synthetic/room_plan.h"
#include "proto/synthetic/texture.h"

namespace mixstage {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;
namespace plan = room_plan;
constexpr double kPi = std::numbers::pi;

constexpr double kOff = 1e-4;  // m: shadow rays start this far above their surface

// Further bounces, as a constant.
const Vector3f kFurther(0.120f, 0.116f, 0.108f);

// Point i of a lattice of n, turned by seed: 0..1 both.
Eigen::Vector2d Lattice(int i, int n, std::uint32_t seed) {
  const double turn_u = static_cast<double>(Mix(seed) >> 8) * 0x1p-24;
  const double turn_v = static_cast<double>(Mix(seed, 77) >> 8) * 0x1p-24;
  const double u = (i + turn_u) / n;
  const double v = 0.6180339887498949 * i + turn_v;
  return {u - std::floor(u), v - std::floor(v)};
}

}  // namespace

double SyntheticLamp::DiscRadius() const { return std::sqrt(4 * half_u.norm() * half_v.norm() / kPi); }

SyntheticLamp WindowLight() {
  SyntheticLamp light;
  light.center = {0.5 * (plan::kWindowX0 + plan::kWindowX1), plan::kLeftY,
                  0.5 * (plan::kWindowZ0 + plan::kWindowZ1)};
  light.half_u = {0.5 * (plan::kWindowX1 - plan::kWindowX0), 0, 0};
  light.half_v = {0, 0, 0.5 * (plan::kWindowZ1 - plan::kWindowZ0)};
  light.normal = -Vector3d::UnitY();
  light.radiance = {4.1f, 4.4f, 4.75f};
  return light;
}

SyntheticLamp SoftboxLight() {
  SyntheticLamp light;
  light.center = {plan::kSoftboxX, plan::kSoftboxY, plan::kSoftboxZ};
  light.half_u = {plan::kSoftboxHalf, 0, 0};
  light.half_v = {0, plan::kSoftboxHalf, 0};
  light.normal = -Vector3d::UnitZ();
  light.radiance = {84.0f, 75.5f, 64.0f};
  return light;
}

float UnitIrradiance(const SyntheticLamp& light, const Vector3d& p, const Vector3d& normal) {
  if (light.normal.dot(p - light.center) <= 0) return 0;
  const std::array<Vector3d, 4> corners = {
      light.center - light.half_u - light.half_v - p, light.center + light.half_u - light.half_v - p,
      light.center + light.half_u + light.half_v - p, light.center - light.half_u + light.half_v - p};
  // Sutherland-Hodgman against the horizon.
  std::array<Vector3d, 6> kept;
  std::size_t count = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const Vector3d& a = corners[i];
    const Vector3d& b = corners[(i + 1) % 4];
    const double ha = a.dot(normal);
    const double hb = b.dot(normal);
    if (ha > 0) kept[count++] = a;
    if ((ha > 0) != (hb > 0)) kept[count++] = a + ha / (ha - hb) * (b - a);
  }
  if (count < 3) return 0;
  double sum = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const Vector3d& a = kept[i];
    const Vector3d& b = kept[(i + 1) % count];
    const Vector3d cross = a.cross(b);
    const double length = cross.norm();
    if (length > 1e-12) sum += std::atan2(length, a.dot(b)) * cross.dot(normal) / length;
  }
  return static_cast<float>(std::abs(sum) / (2 * kPi));
}

RoomLight::RoomLight(const Room& room) : room_(room), window_(WindowLight()), softbox_(SoftboxLight()) {}

float RoomLight::Visibility(const SyntheticLamp& light, const Vector3d& p, const Vector3d& normal, int rays,
                            std::uint32_t seed) const {
  double all = 0;
  double seen = 0;
  for (int i = 0; i < rays; ++i) {
    const Eigen::Vector2d at = Lattice(i, rays, seed);
    const Vector3d to = light.center + (2 * at.x() - 1) * light.half_u + (2 * at.y() - 1) * light.half_v - p;
    const double range = to.norm();
    const Vector3d direction = to / range;
    const double weight = std::max(0.0, normal.dot(direction)) * std::max(0.0, -light.normal.dot(direction));
    if (weight <= 0) continue;
    all += weight;
    if (!room_.Blocked({p + kOff * normal, direction}, range - 2 * kOff, Occluders::kAll)) seen += weight;
  }
  return all > 0 ? static_cast<float>(seen / all) : 0.f;
}

Vector3f RoomLight::Lamp(const Vector3d& p, const Vector3d& normal, std::uint32_t seed) const {
  const Eigen::Vector2d jitter = Lattice(0, 1, seed);
  const Vector3d bulb(plan::kLampX + 0.08 * (jitter.x() - 0.5), plan::kLampY + 0.08 * (jitter.y() - 0.5),
                      plan::kLampZ);
  const Vector3d to = bulb - p;
  const double range = to.norm();
  const Vector3d direction = to / range;
  const double cosine = normal.dot(direction);
  if (cosine <= 0) return Vector3f::Zero();
  // Open above and below, linen at the sides.
  const double steep = std::abs(direction.z());
  const double profile = 0.30 + 0.70 * SmoothStep(0.52f, 0.74f, static_cast<float>(steep));
  const double power = 0.20 * profile * cosine / (range * range + 0.02);
  if (power < 2e-3) return Vector3f::Zero();
  if (room_.Blocked({p + kOff * normal, direction}, range, Occluders::kAllButLamp)) return Vector3f::Zero();
  return static_cast<float>(power) * Vector3f(1.0f, 0.62f, 0.30f);
}

Vector3f RoomLight::Seen(const Ray& ray, std::uint32_t seed) const {
  const Room::Found found = room_.Trace(ray);
  // The window's own light and the lamp's shade are sampled as lights; in reflections they are seen as they
  // are.
  if (found.surface == Surface::kPane) return Vector3f::Zero();
  const Vector3d p = ray.origin + found.range_m * ray.direction;
  const RoomMaterial material = room_.PlainMaterial(found);
  Vector3f light = kFurther;
  for (const SyntheticLamp* area : {&window_, &softbox_}) {
    const float unit = UnitIrradiance(*area, p, found.normal);
    if (unit > 3e-3f) light += unit * Visibility(*area, p, found.normal, 1, Mix(seed, 31)) * area->radiance;
  }
  light += Lamp(p, found.normal, Mix(seed, 13));
  return material.albedo.cwiseProduct(light);
}

Vector3f RoomLight::Bounced(const Vector3d& p, const Vector3d& normal, int rays, std::uint32_t seed) const {
  const Vector3d side = normal.unitOrthogonal();
  const Vector3d other = normal.cross(side);
  Vector3f sum = Vector3f::Zero();
  for (int i = 0; i < rays; ++i) {
    const Eigen::Vector2d at = Lattice(i, rays, seed);
    const double radius = std::sqrt(at.x());  // cosine-weighted: every ray counts the same
    const double around = 2 * kPi * at.y();
    const Vector3d direction = radius * std::cos(around) * side + radius * std::sin(around) * other +
                               std::sqrt(std::max(0.0, 1 - at.x())) * normal;
    sum += Seen({p + kOff * normal, direction}, Mix(seed, static_cast<std::uint32_t>(i)));
  }
  return sum / static_cast<float>(rays);
}

}  // namespace mixstage
