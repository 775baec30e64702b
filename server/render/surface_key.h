// SPDX-License-Identifier: Apache-2.0
//
// What tells the surfaces in a pixel apart: a triangle's normal and material in one word, as this is asked at
// every pixel.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

namespace mixstage {

// Two triangles are one surface when light falls on them alike: same material, normals of length 1 that
// differ by no more than 0.25 along any axis (about 18 degrees).
class SurfaceKey {
 public:
  // A normal that is not finite counts as zero. Materials count by their lower 13 bits: enough for
  // neighbours.
  SurfaceKey(const Eigen::Vector3f& normal, std::uint32_t material) : lanes_(material & 0x1fff) {
    for (int axis = 0; axis < 3; ++axis) {
      const float clamped = normal.allFinite() ? std::clamp(normal[axis], -1.0f, 1.0f) : 0.0f;
      lanes_ = lanes_ << 16 | static_cast<std::uint64_t>(kOne + kOne * clamped);
    }
  }

  // 16 bits each, from the top: material, 4096 (1 + x), y, z of the normal.
  [[nodiscard]] std::uint64_t lanes() const { return lanes_; }

  // All of b are one surface with a.
  template <typename... Keys>
  static bool AreOne(SurfaceKey a, Keys... b) {
    // Four differences in one subtraction: a lane holds kGuard + limit + a - b, where the guard bit stays
    // just when a - b >= -limit; lanes are below 2^14, so nothing is carried or borrowed between them.
    const std::uint64_t from_a = a.lanes_ + (kGuard + kLimit);
    const std::uint64_t to_a = (kGuard + kLimit) - a.lanes_;
    const std::uint64_t near = (... & ((from_a - b.lanes_) & (to_a + b.lanes_)));
    return (near & kGuard) == kGuard;
  }

 private:
  static constexpr float kOne = 4096.0f;
  static constexpr std::uint64_t kGuard = 0x4000'4000'4000'4000;
  static constexpr std::uint64_t kLimit = 0x0000'0400'0400'0400;  // 0 for the material, 0.25 for the normal

  std::uint64_t lanes_;
};

}  // namespace mixstage
