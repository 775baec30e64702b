// SPDX-License-Identifier: Apache-2.0
//
// Lamps as what shading and shadows reckon with: points, each of which stands for a part of a lamp, so that
// large lamps cast soft shadows (MixIn3D 3.2; algorithms 9).
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "server/render/illumination.h"
#include "server/scene/scene.h"

namespace mixstage {

struct LampSample {
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

  bool operator==(const LampSample&) const = default;

  // What arrives at p: toward is a unit vector, share is that of the strength without the surface's cosine.
  struct Incident {
    Eigen::Vector3f toward;
    float share;
  };
  [[nodiscard]] Incident At(const Eigen::Vector3f& p) const;
  // The same in another frame.
  [[nodiscard]] LampSample In(const Eigen::Isometry3d& T_target_source) const;
};

// In the scene's frame. Area lamps are cut into cells, the larger and the stronger into more; together at
// most kMostLampSamples but one for each lamp. Lamps without strength give none.
inline constexpr std::size_t kMostLampSamples = 20;
[[nodiscard]] std::vector<LampSample> SampleLamps(const std::vector<Light>& lights);

}  // namespace mixstage
