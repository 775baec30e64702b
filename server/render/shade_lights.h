// SPDX-License-Identifier: Apache-2.0
//
// Light arriving at surface points, and its mirror-like part: Lambert, Blinn-Phong, ambient from above and
// below.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "server/render/fragment_rows.h"
#include "server/render/illumination.h"

namespace mixstage {

// One lamp in the camera's frame. A directional light is a lamp without distance.
struct CameraLight {
  enum class Kind {
    kDirectional = 1,  // vector: unit, toward the light
    kPoint,            // vector: where it is
    kArea,  // as a point at its centre that shines by the cosine: strength falls with 1 / (pi d^2 + area)
  };
  Kind kind = Kind::kDirectional;
  Eigen::Vector3f vector = Eigen::Vector3f::Zero();
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();  // area: unit, where it shines to
  Eigen::Vector3f strength =
      Eigen::Vector3f::Zero();  // directional: irradiance / pi; point: at 1 m; area: radiance x area
  float area = 0;               // m^2
};

struct CameraIllumination {
  std::vector<CameraLight> lights;
  Eigen::Vector3f up = Eigen::Vector3f::Zero();
  Eigen::Vector3f ambient_above = Eigen::Vector3f::Zero(), ambient_below = Eigen::Vector3f::Zero();
};
[[nodiscard]] CameraIllumination InCamera(const Illumination& light, const Eigen::Isometry3d& T_camera_scene);

// Fills kDiffuseR..kSpecularB of fragments 0..count-1 from their position, normal and shininess, and brings
// the normals to length 1. The scalar one is the specification.
void ShadeLights(const CameraIllumination& light, std::size_t count, FragmentRows& rows);
void ShadeLightsScalar(const CameraIllumination& light, std::size_t count, FragmentRows& rows);

}  // namespace mixstage
