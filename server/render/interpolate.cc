// SPDX-License-Identifier: Apache-2.0
#include "server/render/interpolate.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "proto/base/check.h"

namespace mixstage {
namespace {

constexpr float kMostTaps = 4.0f;
constexpr float kBeside = -0.1f;
constexpr float kLongestStep = 16.0f;  // textures a pixel

// How many samples along the footprint's longer axis, and what each stands for. A sample reaches two texels
// of its level, so one is enough up to 1 : 2 (it is then blurred a little across and sharp a little along),
// two up to 1 : 4 and so on; beyond 1 : 8 they are set apart by as much as they reach. x, y: texels that one
// pixel step to the right and down moves.
void Footprint(const Eigen::Vector2f& x, const Eigen::Vector2f& y, float& taps, float& texels_per_tap) {
  const float longer = std::sqrt(std::max(x.squaredNorm(), y.squaredNorm()));
  const float area = std::abs(x.x() * y.y() - x.y() * y.x());
  const float shorter = area / std::max(longer, 1e-12f);
  const float wanted = std::ceil(0.5f * longer / std::max(shorter, 1e-12f) - 0.01f);
  taps =
      std::min(longer > 1.0f ? kMostTaps : 1.0f, std::max(1.0f, wanted));  // 1 where wanted is not a number
  texels_per_tap = std::max(std::sqrt(area / taps), 0.5f * longer / taps);
}

// Of a triangle that is seen edge on, steps mean nothing, nor may they be numbers.
float SaneStep(float step) { return std::abs(step) <= kLongestStep ? step : 0.0f; }

}  // namespace

void InterpolateScalar(float pixel_rad, std::size_t count, FragmentRows& rows) {
  MIX_CHECK(count <= rows.capacity());
  using enum FragmentRows::Row;
  for (std::size_t i = 0; i < count; ++i) {
    auto at = [&](FragmentRows::Row row) -> float& { return rows.row(row)[i]; };
    auto corner = [&](std::size_t block) {
      return Eigen::Map<const Eigen::Vector4f>(rows.corner(block) + 4 * i);
    };
    const Eigen::Vector3f p0 = corner(0).head<3>();
    const Eigen::Vector3f e1 = corner(1).head<3>() - p0;
    const Eigen::Vector3f e2 = corner(2).head<3>() - p0;
    const Eigen::Vector3f B = p0.cross(e2);
    const Eigen::Vector3f C = e1.cross(p0);
    const Eigen::Vector3f D = e2.cross(e1);
    const Eigen::Vector3f ray(at(kRayX), at(kRayY), 1.0f);
    const float denominator = ray.dot(D);
    const float inverse = std::abs(denominator) > 1e-20f ? 1.0f / denominator : 0.0f;
    const float exact_b = ray.dot(B) * inverse;
    const float exact_c = ray.dot(C) * inverse;
    const float inside_a = std::max(kBeside, 1.0f - exact_b - exact_c);
    const float inside_b = std::max(kBeside, exact_b);
    const float inside_c = std::max(kBeside, exact_c);
    const float sum = 1.0f / std::max(inside_a + inside_b + inside_c, 1e-20f);
    const float b = inside_b * sum;
    const float c = inside_c * sum;

    const Eigen::Vector4f n0 = corner(3);
    const Eigen::Vector4f n1 = corner(4) - n0;
    const Eigen::Vector4f n2 = corner(5) - n0;
    const float u1 = corner(1)[3] - corner(0)[3];
    const float u2 = corner(2)[3] - corner(0)[3];
    const Eigen::Vector3f p = p0 + b * e1 + c * e2;
    // Counter-clockwise corners have a positive denominator: D points out of the back, along the ray.
    const float side = denominator * at(kFront) < 0 ? -1.0f : 1.0f;
    const Eigen::Vector3f n = side * (n0 + b * n1 + c * n2).head<3>();
    at(kX) = p.x(), at(kY) = p.y(), at(kZ) = p.z();
    at(kNx) = n.x(), at(kNy) = n.y(), at(kNz) = n.z();
    at(kU) = corner(0)[3] + b * u1 + c * u2;
    at(kV) = n0[3] + b * n1[3] + c * n2[3];
    at(kWeight1) = b, at(kWeight2) = c;

    const float step = pixel_rad * inverse;
    const Eigen::Vector2f db = step * (B - exact_b * D).head<2>();
    const Eigen::Vector2f dc = step * (C - exact_c * D).head<2>();
    const Eigen::Vector2f du = db * u1 + dc * u2;  // per pixel to the right, down
    const Eigen::Vector2f dv = db * n1[3] + dc * n2[3];
    const Eigen::Vector2f size(at(kTextureWidth), at(kTextureHeight));
    const Eigen::Vector2f right = Eigen::Vector2f(du.x(), dv.x()).cwiseProduct(size);
    const Eigen::Vector2f down = Eigen::Vector2f(du.y(), dv.y()).cwiseProduct(size);
    const bool right_is_longer = right.squaredNorm() >= down.squaredNorm();
    at(kStepU) = SaneStep(right_is_longer ? du.x() : du.y());
    at(kStepV) = SaneStep(right_is_longer ? dv.x() : dv.y());
    Footprint(right, down, at(kTaps), at(kTexelsPerTap));
  }
}

}  // namespace mixstage
