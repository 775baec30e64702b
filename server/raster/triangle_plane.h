// SPDX-License-Identifier: Apache-2.0
//
// Perspective-correct barycentric coordinates of a pixel: its undistorted ray meets the triangle's plane.
// Exact through any lens, whatever pieces the rasteriser drew the triangle in.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>

namespace mixstage {

struct TrianglePoint {
  float depth_m = 0;   // z along the camera's axis
  float b = 0, c = 0;  // weights of corners b and c; that of a is 1 - b - c. Slightly outside [0, 1] at edges
};

// One triangle, prepared for many pixels. Corners in the camera's frame, metres; copied.
class TrianglePlane {
 public:
  TrianglePlane(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c) : a_(a) {
    const Eigen::Vector3f ab = b - a;
    const Eigen::Vector3f ac = c - a;
    normal_ = ab.cross(ac);
    const float squared = normal_.squaredNorm();
    if (squared > 0) {
      to_b_ = ac.cross(normal_) / squared;
      to_c_ = normal_.cross(ab) / squared;
    }
    offset_ = normal_.dot(a);
  }

  // ray: (x/z, y/z) of the pixel (UnprojectionTable). Nothing for a ray along the plane, for a triangle
  // without area and for what lies behind the camera.
  [[nodiscard]] std::optional<TrianglePoint> At(const Eigen::Vector2f& ray) const {
    const float depth_m = offset_ / (normal_.x() * ray.x() + normal_.y() * ray.y() + normal_.z());
    if (!(depth_m > 0 && depth_m < 1e6f)) return std::nullopt;
    // From corner a, so that small triangles far away keep their digits.
    const Eigen::Vector3f from_a(depth_m * ray.x() - a_.x(), depth_m * ray.y() - a_.y(), depth_m - a_.z());
    return TrianglePoint{depth_m, to_b_.dot(from_a), to_c_.dot(from_a)};
  }
  // ab x ac, not normalised.
  [[nodiscard]] const Eigen::Vector3f& normal() const { return normal_; }

 private:
  Eigen::Vector3f a_, normal_;
  Eigen::Vector3f to_b_ = Eigen::Vector3f::Zero(), to_c_ = Eigen::Vector3f::Zero();
  float offset_ = 0;
};

}  // namespace mixstage
