// SPDX-License-Identifier: Apache-2.0
//
// The specifications of figure_kernels: one pixel, one caster at a time.
#include <algorithm>
#include <cmath>

#include "proto/synthetic/figure_kernels.h"

namespace mixstage {

void AddNoiseScalar(const std::int16_t* base, const std::int8_t* noise, int count, int gain, int slope,
                    std::uint8_t* out) {
  for (int i = 0; i < count; ++i) {
    const int g = gain - slope * (base[i] >> 9);
    out[i] = static_cast<std::uint8_t>(std::clamp((base[i] + (noise[i] * g >> 4) + 32) >> 6, 0, 255));
  }
}

// Seen from the point, the lamp is a disc that is `spread` wide per metre of distance; where the line to its
// centre passes the caster closest, the caster covers a band of that disc.
float OccludedShare(const SoftLamp& lamp, const Caster& caster, float radius, float from_m,
                    const float point[3]) {
  const Eigen::Vector3f p(point[0], point[1], point[2]);
  const Eigen::Vector3f ab(caster.ab[0], caster.ab[1], caster.ab[2]);
  const Eigen::Vector3f w = p - Eigen::Vector3f(caster.a[0], caster.a[1], caster.a[2]);
  Eigen::Vector3f l = Eigen::Vector3f(lamp.center[0], lamp.center[1], lamp.center[2]) - p;
  const float T = std::max(l.norm(), 1e-3f);
  l /= T;
  const float B = l.dot(ab);
  const float D = l.dot(w);
  const float s = std::clamp((ab.dot(w) - B * D) / std::max(caster.length2 - B * B, 1e-6f), 0.f, 1.f);
  const float t = std::clamp(s * B - D, from_m, T);
  const float distance = (w + t * l - s * ab).norm();
  const float reach = t * lamp.radius / T + 1e-3f;
  const float covered = std::min(distance + radius, reach) - std::max(distance - radius, -reach);
  return std::clamp(covered / (2 * reach), 0.f, 1.f);
}

float CameraResponse(float linear) {
  constexpr float kKnee = 0.7f;
  const float over = linear - kKnee;
  const float x = std::clamp(over > 0 ? kKnee + over / (1 + over / 0.32f) : linear, 0.f, 1.f);
  return x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
}

}  // namespace mixstage
