// SPDX-License-Identifier: Apache-2.0
#include "server/scene/edit_change.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numbers>
#include <string>

#include "proto/base/check.h"
#include "server/scene/scene_file.h"

namespace mixstage {
namespace {

constexpr double kMostDegrees = 36'000;
constexpr float kMostIntensity = 1000;
constexpr double kFarthestOrigin = 1e5;  // what scene.yaml takes
// Nothing on a stage is larger; a model that is was written in centimetres, millimetres, ...
constexpr double kLargestModel = 10;
constexpr double kLeastScale = 1e-4;  // what scene.yaml takes
constexpr std::size_t kMostAdopted = 64;

tl::unexpected<Error> Refuse(std::string sentence) { return Fail(ErrorCode::kBadInput, std::move(sentence)); }

Eigen::Vector3d ToVector(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }
std::array<double, 3> ToArray(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

std::string Metres(double m) {
  char text[40];
  std::snprintf(text, sizeof text, "%g m", m);
  return text;
}

// A name that no object of the scene has yet: "vase", "vase 2", ...
std::string FreeName(const Scene& scene, const std::string& wanted) {
  const auto taken = [&](const std::string& name) {
    return std::ranges::any_of(scene.objects, [&](const SceneObject& object) { return object.name == name; });
  };
  std::string name = wanted;
  for (int i = 2; taken(name); ++i) name = wanted + " " + std::to_string(i);
  return name;
}

struct Change {
  Scene& scene;
  const EditContext& context;

  Result<SceneObject*> Find(std::uint32_t id) const {
    const auto found = std::ranges::find(scene.objects, id, &SceneObject::id);
    if (found != scene.objects.end()) return &*found;
    return Refuse("There is no object " + std::to_string(id) + " in the scene (any more).");
  }

  [[nodiscard]] Stand StandOfObject(const SceneObject& object) const {
    return context.stands[object.id](object.mesh, object.T_scene_object, UpOf(scene.frame));
  }

  [[nodiscard]] Status Inside(const Eigen::Vector3d& point, const char* what) const {
    if (point.allFinite() && point.norm() <= context.room_m) return {};
    return Refuse(std::string(what) + " would be more than " + Metres(context.room_m) +
                  " from the scene's origin.");
  }

  Status PutBase(SceneObject& object, const Eigen::Vector3d& base) const {
    if (auto inside = Inside(base, object.name.c_str()); !inside) return inside;
    const Eigen::Vector3d shift = base - StandOfObject(object).base;
    object.T_scene_object.pretranslate(shift);
    object.put = ++context.last_put;
    return Keep(object);
  }

  // The placing follows the pose where the object has one.
  static Status Keep(SceneObject& object) {
    if (!(object.T_scene_object.matrix().array().abs() <= kFarthestOrigin).all()) {
      return Refuse(object.name + ": its file's origin would lie more than 100 km away.");
    }
    if (!object.placing) return {};
    object.placing->position = ToArray(object.T_scene_object.translation());
    object.T_scene_object = TSceneObject(*object.placing, object.usual_up);
    return {};
  }

  Result<Eigen::Vector3d> Surface(const PicturePoint& at) const {
    const auto point = context.room.SurfaceUnder(at.u, at.v);
    if (!point)
      return Refuse("The room's depth is not known there: choose a place that the depth picture shows.");
    return *point;
  }

  Status operator()(const AddObject& add) const {
    MIX_CHECK(context.model != nullptr && context.model->mesh != nullptr);
    if (scene.objects.size() >= kMaxSceneObjects) {
      return Refuse("The scene has " + std::to_string(kMaxSceneObjects) +
                    " objects already: delete one first.");
    }
    std::size_t triangles = context.model->mesh->triangle_count();
    for (const SceneObject& other : scene.objects) triangles += other.mesh->triangle_count();
    if (triangles > kMaxSceneTriangles) {
      return Refuse("With " + add.file + " the scene would have more than 20 million triangles.");
    }
    const auto base = Surface(add.at);
    if (!base) return tl::unexpected(base.error());
    SceneObject object;
    object.id = context.last_object_id + 1;
    object.name = FreeName(scene, std::filesystem::path(add.file).stem().string());
    object.file = add.file;
    object.mesh = context.model->mesh;
    object.usual_up = context.model->up;
    Placing placing;
    const double size = context.model->mesh->Bounds().sizes().maxCoeff();
    while (size * placing.scale > kLargestModel) placing.scale /= 10;
    if (placing.scale < kLeastScale) return Refuse(add.file + " is larger than 100 km.");
    // A placing stands along z: a camera's scene has its up along -y.
    if (scene.frame == SceneFrame::kCamera) placing.rotation_deg[0] = 90;
    object.T_scene_object = TSceneObject(placing, object.usual_up);
    object.placing = placing;
    if (auto ok = PutBase(object, *base); !ok) return ok;
    scene.objects.push_back(std::move(object));
    ++context.last_object_id;
    return {};
  }

  Result<Eigen::Vector3d> Target(const SceneObject&, const ToSurface& to) const { return Surface(to.at); }
  Result<Eigen::Vector3d> Target(const SceneObject&, const ToPosition& to) const {
    return ToVector(to.position);
  }
  Result<Eigen::Vector3d> Target(const SceneObject& object, const AlongFloor& to) const {
    const Eigen::Vector3d base = StandOfObject(object).base;
    const Eigen::Vector3d up = UpOf(scene.frame);
    const auto ray = context.room.RayThrough(to.at.u, to.at.v);
    const double fall = ray ? up.dot(ray->direction.normalized()) : 0;
    const double t = std::abs(fall) > 1e-3 ? up.dot(base - ray->origin) / fall : 0;
    if (!(t > 0)) return Refuse("Under this pixel there is no point at the height of " + object.name + ".");
    return Eigen::Vector3d(ray->origin + t * ray->direction.normalized());
  }

  Status operator()(const MoveObject& move) const {
    const auto object = Find(move.object);
    if (!object) return tl::unexpected(object.error());
    const auto base = std::visit([&](const auto& to) { return Target(**object, to); }, move.to);
    if (!base) return tl::unexpected(base.error());
    return PutBase(**object, *base);
  }

  Status operator()(const TurnObject& turn) const {
    const auto found = Find(turn.object);
    if (!found) return tl::unexpected(found.error());
    if (!(std::abs(turn.angle_deg) <= kMostDegrees))
      return Refuse("An object turns by 36000 degrees at most.");
    SceneObject& object = **found;
    const Eigen::Vector3d base = StandOfObject(object).base;
    const double angle_rad = turn.angle_deg * std::numbers::pi / 180;
    const Eigen::Affine3d about_base = Eigen::Translation3d(base) *
                                       Eigen::AngleAxisd(angle_rad, UpOf(scene.frame)) *
                                       Eigen::Translation3d(-base);
    object.T_scene_object = about_base * object.T_scene_object;
    object.put = ++context.last_put;
    if (object.placing) {
      // Rz Ry Rx takes a turn about z as it is; one about -y where nothing comes after Ry.
      std::array<double, 3>& rotation = object.placing->rotation_deg;
      if (scene.frame == SceneFrame::kWorld) {
        rotation[2] = std::remainder(rotation[2] + turn.angle_deg, 360.0);
      } else if (rotation[2] == 0) {
        rotation[1] = std::remainder(rotation[1] - turn.angle_deg, 360.0);
      } else {
        object.placing.reset();
      }
    }
    return Keep(object);
  }

  Status operator()(const DropObject& drop) const {
    const auto found = Find(drop.object);
    if (!found) return tl::unexpected(found.error());
    SceneObject& object = **found;
    const Stand stand = StandOfObject(object);
    // A world has a floor.
    if (scene.frame != SceneFrame::kWorld && !context.room.HighestSurfaceBelow(stand.base, stand.radius_m)) {
      return Refuse("The depth picture shows nothing under " + object.name + ".");
    }
    object.drop = true;
    object.put = ++context.last_put;
    return {};
  }

  Status operator()(const DeleteObject& gone) const {
    const auto found = Find(gone.object);
    if (!found) return tl::unexpected(found.error());
    scene.objects.erase(scene.objects.begin() + (*found - scene.objects.data()));
    return {};
  }

  Status operator()(const HideObject& hide) const {
    const auto found = Find(hide.object);
    if (!found) return tl::unexpected(found.error());
    (*found)->hidden = hide.hidden;
    return {};
  }

  Status operator()(const AnimateObject& animate) const {
    const auto found = Find(animate.object);
    if (!found) return tl::unexpected(found.error());
    SceneObject& object = **found;
    const auto clip = object.mesh->motion ? FindClip(*object.mesh->motion, animate.animation) : std::nullopt;
    if (!clip) return Refuse(object.name + " has no animation \"" + animate.animation + "\".");
    object.clip = *clip;
    return {};
  }

  Status operator()(const ChangeLight& change) const {
    if (scene.lights.empty() &&
        std::ranges::count(context.default_light.lights, change.light, &Light::id) > 0) {
      scene.lights = context.default_light.lights;
      if (!scene.ambient) scene.ambient = context.default_light.ambient;
    }
    const auto light = std::ranges::find(scene.lights, change.light, &Light::id);
    if (light == scene.lights.end()) {
      return Refuse("There is no light " + std::to_string(change.light) + " in the scene.");
    }
    if (change.color) {
      const Eigen::Vector3d color = ToVector(*change.color);
      if (!((color.array() >= 0).all() && (color.array() <= 1).all())) {
        return Refuse(light->name + ": a light's color is three numbers from 0 to 1.");
      }
      light->color = color.cast<float>();
    }
    if (change.intensity) {
      if (!(*change.intensity >= 0 && *change.intensity <= kMostIntensity)) {
        return Refuse(light->name + ": a light's intensity is from 0 to 1000.");
      }
      light->intensity = static_cast<float>(*change.intensity);
    }
    return change.position ? MoveLight(*light, ToVector(*change.position)) : Status();
  }

  Status operator()(const PlaceAvatar& place) const {
    if (!scene.avatar) return Refuse("The actor stays where he is: the scene has no avatar.");
    if (place.position) {
      if (auto inside = Inside(ToVector(*place.position), "The avatar"); !inside) return inside;
      scene.avatar->position = ToVector(*place.position);
    }
    if (place.turn_deg) {
      if (!(std::abs(*place.turn_deg) <= kMostDegrees))
        return Refuse("The avatar turns by 36000 degrees at most.");
      scene.avatar->turn_deg = std::remainder(*place.turn_deg, 360.0);
    }
    return {};
  }

  Status operator()(const AdoptThing&) const {
    MIX_CHECK(context.thing != nullptr);
    if (scene.adopted.size() >= kMostAdopted)
      return Refuse("64 things are the room's already: scan the room again, or forget them.");
    scene.adopted.push_back(context.thing);
    return {};
  }

  Status operator()(const ForgetThings&) const {
    if (scene.adopted.empty()) return Refuse("Nothing was adopted into the room.");
    scene.adopted.clear();
    return {};
  }

  Status MoveLight(Light& light, const Eigen::Vector3d& position) const {
    if (auto inside = Inside(position, light.name.c_str()); !inside) return inside;
    if (auto* point = std::get_if<PointLight>(&light.shape)) {
      point->position = position;
    } else if (auto* area = std::get_if<AreaLight>(&light.shape)) {
      area->center = position;
    } else {
      if (!(position.norm() > 1e-6)) return Refuse(light.name + ": its direction has length 0.");
      std::get<DirectionalLight>(light.shape).toward_light = position.normalized();
    }
    return {};
  }

  // Not changes of a scene: the editor has them before.
  Status operator()(const UndoEdit&) const { return NotHere(); }
  Status operator()(const RedoEdit&) const { return NotHere(); }
  Status operator()(const SaveScene&) const { return NotHere(); }
  static Status NotHere() {
    MIX_CHECK(false);
    return {};
  }
};

}  // namespace

Status ChangeScene(const EditOp& op, Scene& scene, const EditContext& context) {
  return std::visit(Change{scene, context}, op);
}

}  // namespace mixstage
