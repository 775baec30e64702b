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
// Objects stand on their origins more often than not.
constexpr double kOverFloor_m = 0.3;

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

UsualLight UsualLightOf(SceneFrame frame) {
  const bool world = frame == SceneFrame::kWorld;
  const Eigen::Vector3d left = world ? Eigen::Vector3d::UnitY() : Eigen::Vector3d(-Eigen::Vector3d::UnitX());
  const Eigen::Vector3d front =
      world ? Eigen::Vector3d(-Eigen::Vector3d::UnitX()) : Eigen::Vector3d(-Eigen::Vector3d::UnitZ());
  UsualLight usual;
  usual.key.name = "key";
  usual.key.shape = DirectionalLight{(UpOf(frame) + 0.5 * left + 0.6 * front).normalized()};
  usual.key.intensity = kKey;
  usual.ambient = {kAmbientAbove, kAmbientBelow};
  return usual;
}

Illumination IlluminationOf(const Scene& scene, const RoomRadiance* room) {
  Illumination light;
  const UsualLight usual = UsualLightOf(scene.frame);
  if (scene.frame != SceneFrame::kWorld) room = nullptr;
  light.lights = scene.lights;
  if (light.lights.empty() && room != nullptr) light.lights = room->lamps();
  const bool lit = !light.lights.empty();
  if (!lit) light.lights = {usual.key};
  if (scene.ambient || room == nullptr || !lit) {
    const Ambient ambient =
        scene.ambient.value_or(lit ? Ambient{kScatteredAbove, kScatteredBelow} : usual.ambient);
    light.ambient =
        AmbientLight::AboveBelow(UpOf(scene.frame).cast<float>(), Eigen::Vector3f::Constant(ambient.above),
                                 Eigen::Vector3f::Constant(ambient.below));
    return light;
  }
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const SceneObject& object : scene.objects)
    middle += object.T_scene_object.translation() / static_cast<double>(scene.objects.size());
  light.ambient = room->At(middle + kOverFloor_m * UpOf(scene.frame));
  return light;
}

bool SameLight(const Illumination& a, const Illumination& b) {
  if (a.lights.size() != b.lights.size() || a.ambient != b.ambient) return false;
  for (std::size_t i = 0; i < a.lights.size(); ++i) {
    if (a.lights[i].color != b.lights[i].color || a.lights[i].intensity != b.lights[i].intensity)
      return false;
    if (!SameShape(a.lights[i], b.lights[i])) return false;
  }
  return true;
}

}  // namespace mixstage
