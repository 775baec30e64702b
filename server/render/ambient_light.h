// SPDX-License-Identifier: Apache-2.0
//
// The light that comes from everywhere: irradiance / pi on a white surface as a function of its normal, by
// spherical harmonics of order 2 (Ramamoorthi, Hanrahan 2001, eq 11-12; MixIn3D 3.2's ambient from the
// panorama).
#pragma once

#include <Eigen/Core>
#include <array>

namespace mixstage {

struct AmbientLight {
  static constexpr std::size_t kTerms = 10;
  // R, G, B: a polynomial of the unit normal (x, y, z); factors of 1, x, y, z, xx, yy, zz, xy, xz, yz.
  std::array<std::array<float, kTerms>, 3> terms{};

  bool operator==(const AmbientLight&) const = default;
  // What a surface gets; the polynomial's dips below zero are cut off.
  [[nodiscard]] Eigen::Vector3f At(const Eigen::Vector3f& normal) const;
  // The same light in a frame turned by R_target_source.
  [[nodiscard]] AmbientLight Turned(const Eigen::Matrix3f& R_target_source) const;

  // above on a surface that faces up, below on one that faces down, linear between them.
  static AmbientLight AboveBelow(const Eigen::Vector3f& up, const Eigen::Vector3f& above,
                                 const Eigen::Vector3f& below);
};

// Adds up what shines onto a point.
class AmbientSum {
 public:
  // radiance from a unit direction, out of solid_angle (steradians).
  void Add(const Eigen::Vector3f& toward, float solid_angle, const Eigen::Vector3f& radiance);
  // Directions that nothing was added for shine like the mean of the others.
  [[nodiscard]] AmbientLight Finish() const;

 private:
  std::array<Eigen::Vector3f, 9> L_{
      Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(),
      Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(),
      Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero(), Eigen::Vector3f::Zero()};
  Eigen::Vector3f light_ = Eigen::Vector3f::Zero();
  float solid_angle_ = 0;
};

}  // namespace mixstage
