// SPDX-License-Identifier: Apache-2.0
#include "server/render/illumination.h"

namespace mixstage {
namespace {

// An indoor picture is exposed so that a white surface in the full light stays a little below white, for the
// highlights: key and ambient from above come to 0.8 to 0.9 on it. Half of the ambient comes back from the
// floor.
constexpr float kKey = 0.5f;
constexpr float kAmbientAbove = 0.4f;
constexpr float kAmbientBelow = 0.2f;
// Beside given lamps only what walls and ceiling scatter, so that the far side is not black.
constexpr float kScatteredAbove = 0.1f;
constexpr float kScatteredBelow = 0.06f;

bool SameShape(const Light& a, const Light& b) {
  if (a.shape.index() != b.shape.index()) return false;
  if (const auto* point = std::get_if<PointLight>(&a.shape)) {
    return point->position == std::get<PointLight>(b.shape).position;
  }
  if (const auto* sun = std::get_if<DirectionalLight>(&a.shape)) {
    return sun->toward_light == std::get<DirectionalLight>(b.shape).toward_light;
  }
  const auto& area = std::get<AreaLight>(a.shape);
  const auto& other = std::get<AreaLight>(b.shape);
  return area.center == other.center && area.edge_u == other.edge_u && area.edge_v == other.edge_v;
}

}  // namespace

Illumination IlluminationOf(const Scene& scene) {
  Illumination light;
  light.up = UpOf(scene.frame);
  light.lights = scene.lights;
  const bool lit = !scene.lights.empty();
  const Ambient usual =
      lit ? Ambient{kScatteredAbove, kScatteredBelow} : Ambient{kAmbientAbove, kAmbientBelow};
  const Ambient ambient = scene.ambient.value_or(usual);
  light.ambient_above.setConstant(ambient.above);
  light.ambient_below.setConstant(ambient.below);
  if (lit) return light;
  const bool world = scene.frame == SceneFrame::kWorld;
  const Eigen::Vector3d left = world ? Eigen::Vector3d::UnitY() : Eigen::Vector3d(-Eigen::Vector3d::UnitX());
  const Eigen::Vector3d front =
      world ? Eigen::Vector3d(-Eigen::Vector3d::UnitX()) : Eigen::Vector3d(-Eigen::Vector3d::UnitZ());
  Light key;
  key.name = "key";
  key.shape = DirectionalLight{(light.up + 0.5 * left + 0.6 * front).normalized()};
  key.intensity = kKey;
  light.lights.push_back(key);
  return light;
}

bool SameLight(const Illumination& a, const Illumination& b) {
  if (a.lights.size() != b.lights.size() || a.up != b.up) return false;
  if (a.ambient_above != b.ambient_above || a.ambient_below != b.ambient_below) return false;
  for (std::size_t i = 0; i < a.lights.size(); ++i) {
    if (a.lights[i].color != b.lights[i].color || a.lights[i].intensity != b.lights[i].intensity)
      return false;
    if (!SameShape(a.lights[i], b.lights[i])) return false;
  }
  return true;
}

}  // namespace mixstage
