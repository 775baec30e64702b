// SPDX-License-Identifier: Apache-2.0
//
// Light arriving at surface points, and its mirror-like part: Lambert, Blinn-Phong, ambient by
// spherical harmonics.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "server/render/fragment_rows.h"
#include "server/render/illumination.h"
#include "server/render/lamp_samples.h"

namespace mixstage {

using CameraLight = LampSample;  // in the camera's frame

struct CameraIllumination {
  std::vector<CameraLight> lights;
  AmbientLight ambient;
};
[[nodiscard]] CameraIllumination InCamera(const Illumination& light, const Eigen::Isometry3d& T_camera_scene);

// Fills kDiffuseR..kSpecularB of fragments 0..count-1 from their position, normal and shininess, and brings
// the normals to length 1. The scalar one is the specification.
void ShadeLights(const CameraIllumination& light, std::size_t count, FragmentRows& rows);
void ShadeLightsScalar(const CameraIllumination& light, std::size_t count, FragmentRows& rows);

}  // namespace mixstage
