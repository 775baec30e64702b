// SPDX-License-Identifier: Apache-2.0
#include "server/render/ambient_light.h"

#include <algorithm>
#include <numbers>

namespace mixstage {

Eigen::Vector3f AmbientLight::At(const Eigen::Vector3f& n) const {
  const float x = n.x(), y = n.y(), z = n.z();
  Eigen::Vector3f light;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto& t = terms[c];
    light[static_cast<Eigen::Index>(c)] =
        std::max(0.0f, t[0] + t[1] * x + t[2] * y + t[3] * z + t[4] * x * x + t[5] * y * y + t[6] * z * z +
                           t[7] * x * y + t[8] * x * z + t[9] * y * z);
  }
  return light;
}

AmbientLight AmbientLight::Turned(const Eigen::Matrix3f& R) const {
  AmbientLight out;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto& t = terms[c];
    Eigen::Matrix3f A;
    A << t[4], 0.5f * t[7], 0.5f * t[8], 0.5f * t[7], t[5], 0.5f * t[9], 0.5f * t[8], 0.5f * t[9], t[6];
    const Eigen::Matrix3f B = R * A * R.transpose();
    const Eigen::Vector3f b = R * Eigen::Vector3f(t[1], t[2], t[3]);
    out.terms[c] = {t[0],    b.x(),   b.y(),       b.z(),       B(0, 0),
                    B(1, 1), B(2, 2), 2 * B(0, 1), 2 * B(0, 2), 2 * B(1, 2)};
  }
  return out;
}

AmbientLight AmbientLight::AboveBelow(const Eigen::Vector3f& up, const Eigen::Vector3f& above,
                                      const Eigen::Vector3f& below) {
  AmbientLight out;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto i = static_cast<Eigen::Index>(c);
    const float half = 0.5f * (above[i] - below[i]);
    out.terms[c] = {below[i] + half, half * up.x(), half * up.y(), half * up.z()};
  }
  return out;
}

void AmbientSum::Add(const Eigen::Vector3f& d, float solid_angle, const Eigen::Vector3f& radiance) {
  const float x = d.x(), y = d.y(), z = d.z();
  const std::array<float, 9> Y = {0.282095f,
                                  0.488603f * y,
                                  0.488603f * z,
                                  0.488603f * x,
                                  1.092548f * x * y,
                                  1.092548f * y * z,
                                  0.315392f * (3 * z * z - 1),
                                  1.092548f * x * z,
                                  0.546274f * (x * x - y * y)};
  const Eigen::Vector3f light = solid_angle * radiance;
  for (std::size_t i = 0; i < 9; ++i) L_[i] += Y[i] * light;
  light_ += light;
  solid_angle_ += solid_angle;
}

AmbientLight AmbientSum::Finish() const {
  constexpr float kSphere = 4 * std::numbers::pi_v<float>;
  auto L = L_;
  if (solid_angle_ > 0 && solid_angle_ < kSphere)
    L[0] += 0.282095f * (kSphere - solid_angle_) / solid_angle_ * light_;
  constexpr float c1 = 0.429043f, c2 = 0.511664f, c3 = 0.743125f, c4 = 0.886227f, c5 = 0.247708f;
  AmbientLight out;
  for (std::size_t c = 0; c < 3; ++c) {
    const auto i = static_cast<Eigen::Index>(c);
    auto at = [&](std::size_t k) { return L[k][i] * std::numbers::inv_pi_v<float>; };
    out.terms[c] = {c4 * at(0) - c5 * at(6),
                    2 * c2 * at(3),
                    2 * c2 * at(1),
                    2 * c2 * at(2),
                    c1 * at(8),
                    -c1 * at(8),
                    c3 * at(6),
                    2 * c1 * at(4),
                    2 * c1 * at(7),
                    2 * c1 * at(5)};
  }
  return out;
}

}  // namespace mixstage
