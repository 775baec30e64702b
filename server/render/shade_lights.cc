// SPDX-License-Identifier: Apache-2.0
#include "server/render/shade_lights.h"

#include <algorithm>
#include <cmath>

#include "proto/base/check.h"

namespace mixstage {
CameraIllumination InCamera(const Illumination& in, const Eigen::Isometry3d& T_camera_scene) {
  CameraIllumination out;
  const Eigen::Matrix3d R = T_camera_scene.linear();
  out.ambient = in.ambient.Turned(R.cast<float>());
  for (const LampSample& lamp : SampleLamps(in.lights)) out.lights.push_back(lamp.In(T_camera_scene));
  return out;
}

void ShadeLightsScalar(const CameraIllumination& light, std::size_t count, FragmentRows& rows) {
  MIX_CHECK(count <= rows.capacity());
  auto at = [&](FragmentRows::Row row, std::size_t i) -> float& { return rows.row(row)[i]; };
  for (std::size_t i = 0; i < count; ++i) {
    using enum FragmentRows::Row;
    const Eigen::Vector3f p(at(kX, i), at(kY, i), at(kZ, i));
    const Eigen::Vector3f n = Eigen::Vector3f(at(kNx, i), at(kNy, i), at(kNz, i)).normalized();
    const Eigen::Vector3f view = -p.normalized();
    const float shininess = at(kShininess, i);
    const Eigen::Vector3f ambient = light.ambient.At(n);
    Eigen::Vector3f diffuse = ambient;
    Eigen::Vector3f specular = ambient;
    for (const CameraLight& lamp : light.lights) {
      const CameraLight::Incident incident = lamp.At(p);
      const float received = incident.share * std::max(0.0f, n.dot(incident.toward));
      diffuse += received * lamp.strength;
      const float c = std::max(0.0f, n.dot((incident.toward + view).normalized()));
      // Schlick's x^e ~ x / (e - e x + x), with the exponent's energy (e + 8) / 8.
      const float lobe = c / (shininess - shininess * c + c);
      specular += received * 0.125f * (shininess + 8.0f) * lobe * lamp.strength;
    }
    at(kNx, i) = n.x(), at(kNy, i) = n.y(), at(kNz, i) = n.z();
    at(kDiffuseR, i) = diffuse.x(), at(kDiffuseG, i) = diffuse.y(), at(kDiffuseB, i) = diffuse.z();
    at(kSpecularR, i) = specular.x(), at(kSpecularG, i) = specular.y(), at(kSpecularB, i) = specular.z();
  }
}

}  // namespace mixstage
