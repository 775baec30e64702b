// SPDX-License-Identifier: Apache-2.0
//
// Light in the synthetic room: a large window, a soft box under the ceiling, a lamp, and what the surfaces
// throw back once. All irradiances are divided by pi: albedo times irradiance is the radiance seen, 1 = the
// picture's white.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "proto/synthetic/room.h"

namespace mixstage {

// A rectangle that shines to the side of its normal.
struct SyntheticLamp {
  Eigen::Vector3d center, half_u, half_v;  // m; half side vectors
  Eigen::Vector3d normal;                  // unit
  Eigen::Vector3f radiance;
  // Radius of the disc of the same area: the lamp as soft shadows know it.
  [[nodiscard]] double DiscRadius() const;
};

SyntheticLamp WindowLight();
SyntheticLamp SoftboxLight();

// Unoccluded irradiance from a light of radiance 1 (Lambert's polygon formula, cut at the surface's horizon):
// 0..1.
[[nodiscard]] float UnitIrradiance(const SyntheticLamp& light, const Eigen::Vector3d& p,
                                   const Eigen::Vector3d& normal);

class RoomLight {
 public:
  explicit RoomLight(const Room& room);  // kept by reference

  // Share of a light that reaches a point, 0..1, by `rays` stratified shadow rays; `seed` turns their
  // pattern.
  [[nodiscard]] float Visibility(const SyntheticLamp& light, const Eigen::Vector3d& p,
                                 const Eigen::Vector3d& normal, int rays, std::uint32_t seed) const;
  // Irradiance from the lamp on the sideboard.
  [[nodiscard]] Eigen::Vector3f Lamp(const Eigen::Vector3d& p, const Eigen::Vector3d& normal,
                                     std::uint32_t seed) const;
  // Irradiance from the surfaces around, `rays` over the hemisphere.
  [[nodiscard]] Eigen::Vector3f Bounced(const Eigen::Vector3d& p, const Eigen::Vector3d& normal, int rays,
                                        std::uint32_t seed) const;
  // What is seen along a ray, roughly: mean colours, one shadow ray a light. For bounces and reflections.
  [[nodiscard]] Eigen::Vector3f Seen(const Ray& ray, std::uint32_t seed) const;

  [[nodiscard]] const SyntheticLamp& window() const { return window_; }
  [[nodiscard]] const SyntheticLamp& softbox() const { return softbox_; }

 private:
  const Room& room_;
  SyntheticLamp window_, softbox_;
};

}  // namespace mixstage
