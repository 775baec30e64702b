// SPDX-License-Identifier: Apache-2.0
#include "server/render/shade_lights.h"

#include <algorithm>
#include <cmath>

#include "proto/base/check.h"

namespace mixstage {
namespace {

struct Incident {
  Eigen::Vector3f toward;  // unit
  float share;             // of the strength, without the surface's cosine
};

Incident At(const CameraLight& light, const Eigen::Vector3f& p) {
  if (light.kind == CameraLight::Kind::kDirectional) return {light.vector, 1.0f};
  const Eigen::Vector3f to_light = light.vector - p;
  const float d2 = std::max(to_light.squaredNorm(), 1e-6f);
  const Eigen::Vector3f toward = to_light / std::sqrt(d2);
  if (light.kind == CameraLight::Kind::kPoint) return {toward, 1.0f / d2};
  // The disc of the same area on its axis: E / pi = radiance area / (pi d^2 + area); no pole at the lamp
  // itself.
  const float cosine = std::max(0.0f, -light.normal.dot(toward));
  return {toward, cosine / (static_cast<float>(M_PI) * d2 + light.area)};
}

}  // namespace

CameraIllumination InCamera(const Illumination& in, const Eigen::Isometry3d& T_camera_scene) {
  CameraIllumination out;
  const Eigen::Matrix3d R = T_camera_scene.linear();
  out.up = (R * in.up).cast<float>();
  out.ambient_above = in.ambient_above;
  out.ambient_below = in.ambient_below;
  for (const Light& light : in.lights) {
    CameraLight lamp;
    lamp.strength = light.Strength();
    if (const auto* sun = std::get_if<DirectionalLight>(&light.shape)) {
      lamp.kind = CameraLight::Kind::kDirectional;
      lamp.vector = (R * sun->toward_light).cast<float>();
    } else if (const auto* point = std::get_if<PointLight>(&light.shape)) {
      lamp.kind = CameraLight::Kind::kPoint;
      lamp.vector = (T_camera_scene * point->position).cast<float>();
    } else {
      const auto& area = std::get<AreaLight>(light.shape);
      const Eigen::Vector3d across = area.edge_u.cross(area.edge_v);
      lamp.kind = CameraLight::Kind::kArea;
      lamp.vector = (T_camera_scene * area.center).cast<float>();
      lamp.normal = (R * across.normalized()).cast<float>();
      lamp.area = static_cast<float>(across.norm());
      lamp.strength *= lamp.area;
    }
    out.lights.push_back(lamp);
  }
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
    const float sky = 0.5f + 0.5f * n.dot(light.up);
    const Eigen::Vector3f ambient = light.ambient_below + sky * (light.ambient_above - light.ambient_below);
    Eigen::Vector3f diffuse = ambient;
    Eigen::Vector3f specular = ambient;
    for (const CameraLight& lamp : light.lights) {
      const Incident incident = At(lamp, p);
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
